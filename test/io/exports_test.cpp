#include "cocalib/io/exports.h"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include <boost/property_tree/xml_parser.hpp>
#include <opencv2/core/persistence.hpp>
#include <regex>
#include <sstream>

#include "cocalib/io/rig_file.h"

// Every file is read as its consumer reads it: the same parser where it is a library, and the same use of the numbers.
namespace cocalib {
namespace {

constexpr double kExact = 1e-9;

RigConfig someRig() {
  return parseRig(R"(
imu: {topic: /imu/data, frame: imu_link, gyroscope_noise_density: 1.7e-4, gyroscope_random_walk: 1.0e-6,
      accelerometer_noise_density: 5.9e-4, accelerometer_random_walk: 1.0e-5}
camera: {topic: /camera/image_raw, info_topic: /camera/camera_info, frame: "cam<0>&\"front\""}
lidar: {topic: /points, frame: lidar_link, range_noise: 0.03}
)",
                  "rig.yaml");
}

CameraModel someLens() {
  return CameraModel::fromName("pinhole-radtan", {458.5, 457.25, 367.2, 248.4}, {-0.28, 0.07, 1.9e-4, 1.7e-5}, 752,
                               480);
}

CalibrationEstimate estimateOf(const Pose& T_imu_camera, const Pose& T_imu_lidar) {
  CalibrationEstimate estimate;
  estimate.status = Status::kConverged;
  estimate.camera.valid = estimate.lidar.valid = estimate.lidar_camera.valid = true;
  estimate.calibration.T_imu_camera = T_imu_camera;
  estimate.calibration.T_imu_lidar = T_imu_lidar;
  estimate.calibration.camera_time_offset_s = -0.012345678912345;
  estimate.calibration.lidar_time_offset_s = 1.0e-5 / 3.0;
  return estimate;
}

Pose fromRpy(double roll, double pitch, double yaw, const Eigen::Vector3d& t) {
  return {Eigen::AngleAxisd(yaw, Eigen::Vector3d::UnitZ()) * Eigen::AngleAxisd(pitch, Eigen::Vector3d::UnitY()) *
              Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitX()),
          t};
}

/// A camera that looks ahead, one that is anyhow, and mountings whose roll and yaw turn about one axis.
std::vector<CalibrationEstimate> someEstimates() {
  Eigen::Matrix3d R_ahead;
  R_ahead << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const Pose ahead = {Eigen::Quaterniond(R_ahead), {0.1, -0.02, 1.0 / 3.0}};
  const Pose anyhow = {expSo3({0.4, -1.1, 2.3}), {0.3, -0.2, 1e-7}};
  const Pose down = fromRpy(0.3, M_PI / 2, -0.7, {0.0, 0.5, -0.25});
  const Pose up = fromRpy(2.0, -M_PI / 2, 1.1, {1.0, 2.0, 3.0});
  return {estimateOf(ahead, anyhow), estimateOf(anyhow, down), estimateOf(up, ahead)};
}

std::string textOf(const std::vector<NamedText>& files, const std::string& name) {
  for (const NamedText& file : files) {
    if (file.name == name) return file.text;
  }
  ADD_FAILURE() << name << " is missing";
  return "";
}
std::string textOf(const CalibrationEstimate& estimate, const std::string& name) {
  return textOf(formatExports(someRig(), someLens(), estimate), name);
}

void expectSame(const Eigen::Matrix3d& R, const Eigen::Vector3d& t, const Pose& expected) {
  EXPECT_LT((R - expected.R()).cwiseAbs().maxCoeff(), kExact);
  EXPECT_LT((t - expected.t).cwiseAbs().maxCoeff(), kExact);
}
void expectSame(const Eigen::Matrix4d& T, const Pose& expected) {
  expectSame(T.topLeftCorner<3, 3>(), T.topRightCorner<3, 1>(), expected);
  EXPECT_EQ(T.row(3), Eigen::RowVector4d(0, 0, 0, 1));
}

/// The comment's worked point must be the one that the parsed numbers make.
void expectWorkedPoint(const std::string& text, const std::string& from, const std::string& to, const Pose& T_to_from) {
  const std::string number = R"((-?\d+\.\d+))";
  const auto literal = [](const std::string& frame) {
    return std::regex_replace(frame, std::regex(R"([()])"), R"(\$&)");
  };
  const std::regex pattern(R"(\(1, 2, 3\) m in the )" + literal(from) + R"( frame is \()" + number + ", " + number +
                           ", " + number + R"(\) m in the )" + literal(to) + " frame");
  std::smatch match;
  ASSERT_TRUE(std::regex_search(text, match, pattern)) << text;
  const Eigen::Vector3d said(std::stod(match[1]), std::stod(match[2]), std::stod(match[3]));
  EXPECT_LT((said - T_to_from * Eigen::Vector3d(1, 2, 3)).cwiseAbs().maxCoeff(), 1e-6);
}

template <typename Rows>
Eigen::Matrix4d matrixOf(const Rows& rows) {
  Eigen::Matrix4d T;
  for (int r = 0; r < 4; ++r) {
    for (int c = 0; c < 4; ++c) T(r, c) = rows(r, c);
  }
  return T;
}

/// As Eigen::Map<Matrix<double, -1, -1, RowMajor>>(extRotV.data(), 3, 3) in the LIO programs.
Eigen::Matrix3d rowsOf(const YAML::Node& node) {
  const auto v = node.as<std::vector<double>>();
  EXPECT_EQ(v.size(), 9U);
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(v.data());
}
Eigen::Vector3d vectorOf(const YAML::Node& node) {
  const auto v = node.as<std::vector<double>>();
  EXPECT_EQ(v.size(), 3U);
  return Eigen::Vector3d(v[0], v[1], v[2]);
}
Eigen::Matrix3d matrix3Of(const cv::FileNode& node, int cols) {
  cv::Mat m;
  node >> m;
  EXPECT_EQ(m.type(), CV_64F);
  EXPECT_EQ(m.rows, 3);
  EXPECT_EQ(m.cols, cols);
  Eigen::Matrix3d out = Eigen::Matrix3d::Zero();
  for (int r = 0; r < 3; ++r) {
    for (int c = 0; c < cols; ++c) out(r, c) = m.at<double>(r, c);
  }
  return out;
}

TEST(Exports, KalibrChainTakesImuToCamera) {
  for (const CalibrationEstimate& estimate : someEstimates()) {
    const std::string text = textOf(estimate, "camchain-imucam.yaml");
    const YAML::Node cam = YAML::Load(text)["cam0"];
    const auto rows = cam["T_cam_imu"].as<std::vector<std::vector<double>>>();
    const Pose T_cam_imu = estimate.calibration.T_imu_camera.inverse();
    expectSame(matrixOf([&](int r, int c) { return rows.at(r).at(c); }), T_cam_imu);
    expectWorkedPoint(text, "IMU", "camera", T_cam_imu);
    EXPECT_NEAR(cam["timeshift_cam_imu"].as<double>(), estimate.calibration.camera_time_offset_s, 1e-15);
    EXPECT_EQ(cam["camera_model"].as<std::string>(), "pinhole");
    EXPECT_EQ(cam["distortion_model"].as<std::string>(), "radtan");
    EXPECT_EQ(cam["distortion_coeffs"].as<std::vector<double>>(), someLens().coefficients());
    EXPECT_EQ(cam["intrinsics"].as<std::vector<double>>(), (std::vector<double>{458.5, 457.25, 367.2, 248.4}));
    EXPECT_EQ(cam["resolution"].as<std::vector<int>>(), (std::vector<int>{752, 480}));
    EXPECT_EQ(cam["rostopic"].as<std::string>(), "/camera/image_raw");
    EXPECT_EQ(cam["cam_overlaps"].size(), 0U);
  }
}

TEST(Exports, OpenVinsTakesCameraToImu) {
  for (const CalibrationEstimate& estimate : someEstimates()) {
    const std::string text = textOf(estimate, "open_vins.yaml");
    const cv::FileStorage file(text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    const cv::FileNode cam = file["cam0"];
    expectSame(matrixOf([&](int r, int c) { return static_cast<double>(cam["T_imu_cam"][r][c]); }),
               estimate.calibration.T_imu_camera);
    expectWorkedPoint(text, "camera", "IMU", estimate.calibration.T_imu_camera);
    EXPECT_NEAR(static_cast<double>(cam["timeshift_cam_imu"]), estimate.calibration.camera_time_offset_s, 1e-15);
    EXPECT_NEAR(static_cast<double>(cam["intrinsics"][1]), 457.25, kExact);
    EXPECT_NEAR(static_cast<double>(cam["distortion_coeffs"][3]), 1.7e-5, 1e-15);
    EXPECT_EQ(static_cast<int>(cam["resolution"][1]), 480);
  }
}

TEST(Exports, VinsMonoTakesCameraToImu) {
  for (const CalibrationEstimate& estimate : someEstimates()) {
    const std::string text = textOf(estimate, "vins_mono.yaml");
    const cv::FileStorage file(text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    expectSame(matrix3Of(file["extrinsicRotation"], 3), matrix3Of(file["extrinsicTranslation"], 1).col(0),
               estimate.calibration.T_imu_camera);
    expectWorkedPoint(text, "camera", "IMU", estimate.calibration.T_imu_camera);
    EXPECT_NEAR(static_cast<double>(file["td"]), estimate.calibration.camera_time_offset_s, 1e-15);
    EXPECT_EQ(static_cast<int>(file["estimate_extrinsic"]), 0);
    EXPECT_EQ(static_cast<std::string>(file["model_type"]), "PINHOLE");
    EXPECT_EQ(static_cast<std::string>(file["image_topic"]), "/camera/image_raw");
    EXPECT_NEAR(static_cast<double>(file["distortion_parameters"]["p2"]), 1.7e-5, 1e-15);
    EXPECT_NEAR(static_cast<double>(file["projection_parameters"]["cy"]), 248.4, kExact);
  }
}

TEST(Exports, LviSamCameraTakesLidarToTheForwardLookingCamera) {
  for (const CalibrationEstimate& estimate : someEstimates()) {
    const Calibration& calibration = estimate.calibration;
    const std::string text = textOf(estimate, "lvi_sam_camera.yaml");
    const cv::FileStorage file(text, cv::FileStorage::READ | cv::FileStorage::MEMORY);
    expectSame(matrix3Of(file["extrinsicRotation"], 3), matrix3Of(file["extrinsicTranslation"], 1).col(0),
               calibration.T_imu_camera);
    const auto value = [&](const char* key) { return static_cast<double>(file[std::string("lidar_to_cam_") + key]); };
    // pcl::getTransformation(x, y, z, roll, pitch, yaw), as its lidar_callback calls it.
    const Pose T = fromRpy(value("rx"), value("ry"), value("rz"), {value("tx"), value("ty"), value("tz")});
    const Eigen::Vector3d p_L(1.5, -0.5, 0.25);
    const Eigen::Vector3d p_C = calibration.T_imu_camera.inverse() * (calibration.T_imu_lidar * p_L);
    EXPECT_LT((T * p_L - Eigen::Vector3d(p_C.z(), -p_C.x(), -p_C.y())).cwiseAbs().maxCoeff(), kExact);
    expectWorkedPoint(text, "lidar", "camera (ROS axes)", T);
  }
}

TEST(Exports, SamProgramsTakeImuToLidar) {
  for (const CalibrationEstimate& estimate : someEstimates()) {
    const Pose T_lidar_imu = estimate.calibration.T_imu_lidar.inverse();
    const std::string lio = textOf(estimate, "lio_sam.yaml"), lvi = textOf(estimate, "lvi_sam_lidar.yaml");
    const YAML::Node lio_sam = YAML::Load(lio)["lio_sam"], lvi_sam = YAML::Load(lvi)["lvi_sam"];
    for (const YAML::Node& node : {lio_sam, lvi_sam}) {
      // imuConverter: acc = extRot * acc; imuPreintegration: the IMU stands at extTrans in the lidar's frame.
      expectSame(rowsOf(node["extrinsicRot"]), vectorOf(node["extrinsicTrans"]), T_lidar_imu);
    }
    expectWorkedPoint(lio, "IMU", "lidar", T_lidar_imu);
    expectWorkedPoint(lvi, "IMU", "lidar", T_lidar_imu);
    // q_final = q_from * extQRPY must be the lidar's orientation; LIO-SAM has inverted it before.
    const Eigen::Matrix3d R_world_imu = expSo3({0.3, 0.1, -2.0}).toRotationMatrix();
    const Eigen::Matrix3d R_world_lidar = R_world_imu * estimate.calibration.T_imu_lidar.R();
    EXPECT_LT((R_world_imu * rowsOf(lio_sam["extrinsicRPY"]).inverse() - R_world_lidar).norm(), kExact);
    EXPECT_LT((R_world_imu * rowsOf(lvi_sam["extrinsicRPY"]) - R_world_lidar).norm(), kExact);
  }
}

TEST(Exports, FastLioTakesLidarToImu) {
  for (const CalibrationEstimate& estimate : someEstimates()) {
    const std::string text = textOf(estimate, "fast_lio.yaml");
    const YAML::Node root = YAML::Load(text);
    expectSame(rowsOf(root["mapping"]["extrinsic_R"]), vectorOf(root["mapping"]["extrinsic_T"]),
               estimate.calibration.T_imu_lidar);
    expectWorkedPoint(text, "lidar", "IMU", estimate.calibration.T_imu_lidar);
    // imu_cbk: stamp - time_offset_lidar_to_imu is on the lidar's clock.
    const double t_lidar = 100.0, t_imu = t_lidar + estimate.calibration.lidar_time_offset_s;
    EXPECT_NEAR(t_imu - root["common"]["time_offset_lidar_to_imu"].as<double>(), t_lidar, 1e-12);
    EXPECT_FALSE(root["mapping"]["extrinsic_est_en"].as<bool>());
  }
}

/// Quaternion as urdf::Rotation::setFromRPY makes it.
Eigen::Quaterniond urdfRotation(double roll, double pitch, double yaw) {
  const double phi = roll / 2.0, the = pitch / 2.0, psi = yaw / 2.0;
  using std::cos, std::sin;
  return {cos(phi) * cos(the) * cos(psi) + sin(phi) * sin(the) * sin(psi),
          sin(phi) * cos(the) * cos(psi) - cos(phi) * sin(the) * sin(psi),
          cos(phi) * sin(the) * cos(psi) + sin(phi) * cos(the) * sin(psi),
          cos(phi) * cos(the) * sin(psi) - sin(phi) * sin(the) * cos(psi)};
}

std::vector<double> blanks(const std::string& text) {
  std::istringstream in(text);
  return {std::istream_iterator<double>(in), std::istream_iterator<double>()};
}

boost::property_tree::ptree parseXml(const std::string& text) {
  boost::property_tree::ptree tree;
  std::istringstream in(text);
  boost::property_tree::read_xml(in, tree);
  return tree;
}

TEST(Exports, UrdfJointsStandInTheImuLink) {
  for (const CalibrationEstimate& estimate : someEstimates()) {
    const std::string text = textOf(estimate, "sensors.urdf.xacro");
    const boost::property_tree::ptree tree = parseXml(text);
    int joints = 0;
    for (const auto& [tag, node] : tree.get_child("robot")) {
      if (tag != "joint") continue;
      ++joints;
      EXPECT_EQ(node.get<std::string>("<xmlattr>.type"), "fixed");
      EXPECT_EQ(node.get<std::string>("parent.<xmlattr>.link"), "imu_link");
      const bool camera = node.get<std::string>("<xmlattr>.name") == "imu_to_camera";
      EXPECT_EQ(node.get<std::string>("child.<xmlattr>.link"), camera ? "cam<0>&\"front\"" : "lidar_link");
      const std::vector<double> xyz = blanks(node.get<std::string>("origin.<xmlattr>.xyz"));
      const std::vector<double> rpy = blanks(node.get<std::string>("origin.<xmlattr>.rpy"));
      ASSERT_EQ(xyz.size(), 3U);
      ASSERT_EQ(rpy.size(), 3U);
      const Pose& expected = camera ? estimate.calibration.T_imu_camera : estimate.calibration.T_imu_lidar;
      expectSame(urdfRotation(rpy[0], rpy[1], rpy[2]).toRotationMatrix(), {xyz[0], xyz[1], xyz[2]}, expected);
    }
    EXPECT_EQ(joints, 2);
    expectWorkedPoint(text, "camera", "IMU", estimate.calibration.T_imu_camera);
    expectWorkedPoint(text, "lidar", "IMU", estimate.calibration.T_imu_lidar);
  }
}

TEST(Exports, LaunchFilePublishesParentToChild) {
  for (const CalibrationEstimate& estimate : someEstimates()) {
    const boost::property_tree::ptree tree = parseXml(textOf(estimate, "static_transforms.launch"));
    int nodes = 0;
    for (const auto& [tag, node] : tree.get_child("launch")) {
      if (tag != "node") continue;
      ++nodes;
      EXPECT_EQ(node.get<std::string>("<xmlattr>.pkg"), "tf2_ros");
      EXPECT_EQ(node.get<std::string>("<xmlattr>.type"), "static_transform_publisher");
      std::istringstream args(node.get<std::string>("<xmlattr>.args"));
      double v[7];
      for (double& number : v) args >> number;
      std::string parent, child, more;
      args >> parent >> child;
      EXPECT_FALSE(args >> more);
      EXPECT_EQ(parent, "imu_link");
      const bool lidar = child == "lidar_link";
      expectSame(Eigen::Quaterniond(v[6], v[3], v[4], v[5]).toRotationMatrix(), {v[0], v[1], v[2]},
                 lidar ? estimate.calibration.T_imu_lidar : estimate.calibration.T_imu_camera);
    }
    EXPECT_EQ(nodes, 2);
  }
}

TEST(Exports, WhatIsNotKnownMakesNoFile) {
  CalibrationEstimate estimate = someEstimates()[1];
  EXPECT_EQ(formatExports(someRig(), someLens(), estimate).size(), exportNames().size());
  estimate.camera.valid = false;
  for (const NamedText& file : formatExports(someRig(), someLens(), estimate)) {
    EXPECT_EQ(file.name.find("vins"), std::string::npos);
    EXPECT_EQ(file.text.find("imu_to_camera"), std::string::npos) << file.name;
  }
  estimate.lidar.valid = false;
  EXPECT_TRUE(formatExports(someRig(), someLens(), estimate).empty());
}

TEST(Exports, UnfinishedCalibrationSaysSo) {
  CalibrationEstimate estimate = someEstimates()[1];
  estimate.status = Status::kUnobservable;
  for (const NamedText& file : formatExports(someRig(), someLens(), estimate)) {
    EXPECT_NE(file.text.find("CAUTION: the calibration's status is unobservable"), std::string::npos) << file.name;
  }
}

TEST(Exports, LensesKeepTheirModel) {
  const CalibrationEstimate estimate = someEstimates()[0];
  const CameraModel fisheye =
      CameraModel::fromName("pinhole-equi", {400.0, 401.0, 376.0, 240.0}, {0.01, -0.002, 0.003, -0.0004}, 752, 480);
  const std::vector<NamedText> files = formatExports(someRig(), fisheye, estimate);
  const YAML::Node cam = YAML::Load(textOf(files, "camchain-imucam.yaml"))["cam0"];
  EXPECT_EQ(cam["distortion_model"].as<std::string>(), "equidistant");
  EXPECT_EQ(cam["distortion_coeffs"].as<std::vector<double>>(), fisheye.coefficients());
  const cv::FileStorage vins(textOf(files, "vins_mono.yaml"), cv::FileStorage::READ | cv::FileStorage::MEMORY);
  EXPECT_EQ(static_cast<std::string>(vins["model_type"]), "KANNALA_BRANDT");
  EXPECT_NEAR(static_cast<double>(vins["projection_parameters"]["k5"]), -0.0004, 1e-15);
  EXPECT_NEAR(static_cast<double>(vins["projection_parameters"]["mv"]), 401.0, kExact);

  // A fifth coefficient cannot be said: leaving it out silently would bend the picture's border.
  const CameraModel five =
      CameraModel::fromName("pinhole-radtan", {458.0, 457.0, 367.0, 248.0}, {-0.28, 0.07, 1e-4, 1e-5, -0.01}, 752, 480);
  const YAML::Node without = YAML::Load(textOf(formatExports(someRig(), five, estimate), "camchain-imucam.yaml"));
  EXPECT_FALSE(without["cam0"]["distortion_coeffs"]);
  EXPECT_TRUE(without["cam0"]["T_cam_imu"]);
}

}  // namespace
}  // namespace cocalib
