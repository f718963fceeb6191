#include "cocalib/io/rig_file.h"

#include <gtest/gtest.h>

#include <cstdio>
#include <fstream>
#include <limits>
#include <stdexcept>
#include <string>

#include "cocalib/io/result_file.h"

namespace cocalib {
namespace {

const std::string kImu = R"(
imu:
  topic: /imu/data
  gyroscope_noise_density: 1.745e-4
  gyroscope_random_walk: 1.0e-6
  accelerometer_noise_density: 5.884e-4
  accelerometer_random_walk: 1.0e-5
)";
const std::string kCamera = R"(
camera: {topic: /camera/image_raw, info_topic: /camera/camera_info, frame: camera_optical_frame}
)";
const std::string kLidar = R"(
lidar: {topic: /velodyne_points, frame: lidar_link, range_noise: 0.03}
)";
const std::string kTarget = R"(
target: {type: checkerboard, cols: 8, rows: 6, square: 0.10, board_width: 1.0, board_height: 0.8}
)";
const std::string kFull = kImu + kCamera + kLidar + kTarget;

/// The whole message of the refusal.
std::string refusal(const std::string& yaml) {
  try {
    parseRig(yaml, "my_rig.yaml");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "accepted";
}

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  return text.replace(at, from.size(), to);
}

void expectRefusal(const std::string& yaml, const std::vector<std::string>& words) {
  const std::string message = refusal(yaml);
  EXPECT_EQ(message.find("my_rig.yaml"), 0U) << message;
  EXPECT_EQ(message.find('\n'), std::string::npos) << message;
  for (const std::string& word : words) EXPECT_NE(message.find(word), std::string::npos) << message;
}

TEST(RigFile, ReadsEveryKey) {
  const RigConfig rig = parseRig(kFull + R"(
initial_guess:
  T_imu_camera: {translation: [0.1, 0.2, 0.3], rotation_xyzw: [0.0, 0.0, 0.6, 0.8]}
  T_imu_lidar: {translation: [1, 2, 3]}
)",
                                 "my_rig.yaml");
  EXPECT_EQ(rig.file, "my_rig.yaml");
  EXPECT_EQ(rig.imu.topic, "/imu/data");
  EXPECT_EQ(rig.imu.frame, "imu_link");
  EXPECT_EQ(rig.imu.noise.gyro_noise_density, 1.745e-4);
  EXPECT_EQ(rig.imu.noise.gyro_bias_walk, 1e-6);
  EXPECT_EQ(rig.imu.noise.accel_noise_density, 5.884e-4);
  EXPECT_EQ(rig.imu.noise.accel_bias_walk, 1e-5);
  ASSERT_TRUE(rig.camera);
  EXPECT_EQ(rig.camera->topic, "/camera/image_raw");
  EXPECT_EQ(rig.camera->info_topic, "/camera/camera_info");
  EXPECT_FALSE(rig.camera->model);
  ASSERT_TRUE(rig.lidar);
  EXPECT_EQ(rig.lidar->topic, "/velodyne_points");
  EXPECT_EQ(rig.lidar->range_noise_m, 0.03);
  EXPECT_EQ(rig.lidar->min_range_m, 0.5);
  EXPECT_EQ(rig.lidar->scan_period_s, 0.1);
  ASSERT_TRUE(rig.target);
  EXPECT_EQ(rig.target->cols, 8);
  EXPECT_EQ(rig.target->rows, 6);
  EXPECT_EQ(rig.target->square_m, 0.1);
  EXPECT_EQ(rig.target->width_m.value(), 1.0);
  EXPECT_EQ(rig.target->height_m.value(), 0.8);
  ASSERT_TRUE(rig.guess_T_imu_camera && rig.guess_T_imu_lidar);
  EXPECT_EQ(rig.guess_T_imu_camera->t, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_NEAR(rig.guess_T_imu_camera->q.z(), 0.6, 1e-15);
  EXPECT_NEAR(rig.guess_T_imu_camera->q.w(), 0.8, 1e-15);
  EXPECT_EQ(rig.guess_T_imu_lidar->q.w(), 1.0);
}

TEST(RigFile, EverySectionButTheImuMayBeLeftOut) {
  EXPECT_FALSE(parseRig(kImu + kCamera, "r").lidar);
  EXPECT_FALSE(parseRig(kImu + kLidar, "r").camera);
  EXPECT_FALSE(parseRig(kImu + kLidar, "r").target);
  expectRefusal(kCamera + kLidar, {"'imu': is missing"});
  expectRefusal(kImu + kTarget, {"neither 'camera' nor 'lidar'"});
}

TEST(RigFile, CameraModelInPlaceOfCameraInfo) {
  const std::string camera = R"(
camera:
  topic: /cam0/image_raw/compressed
  model: pinhole-equi
  intrinsics: [1176.93, 1177.72, 962.275, 612.725]
  distortion: [-0.0540096, -0.0784275, 0.0959641, -0.0515253]
  resolution: [1920, 1208]
)";
  const RigConfig rig = parseRig(kImu + camera, "r");
  ASSERT_TRUE(rig.camera->model);
  EXPECT_EQ(rig.camera->model->distortion(), CameraModel::Distortion::kEquidistant);
  EXPECT_EQ(rig.camera->model->width(), 1920);
  EXPECT_EQ(rig.camera->model->intrinsics()[3], 612.725);

  expectRefusal(kImu + camera + "  info_topic: /info\n", {"camera: info_topic", "either"});
  expectRefusal(kImu + replaced(camera, "pinhole-equi", "omni"), {"camera: model", "omni", "pinhole-radtan"});
  expectRefusal(kImu + replaced(camera, "-0.0540096, ", ""), {"camera: distortion", "4 coefficients"});
  expectRefusal(kImu + replaced(camera, "962.275", "2962.275"), {"camera: intrinsics", "inside the picture"});
  expectRefusal(kImu + replaced(camera, "1176.93", "1.17"), {"camera: intrinsics", "[10, 1e5] px"});
  expectRefusal(kImu + replaced(camera, "1920, ", ""), {"camera: resolution", "2 numbers"});
  expectRefusal(kImu + replaced(camera, "1920", "1920.5"), {"camera: resolution", "whole numbers"});
  expectRefusal(kImu + replaced(camera, "  resolution: [1920, 1208]\n", ""), {"camera: resolution", "is missing"});
  expectRefusal(kImu + "camera: {topic: /camera}\n", {"camera: info_topic", "is missing"});
}

TEST(RigFile, LidarOverrides) {
  const RigConfig rig = parseRig(kImu + R"(
lidar:
  topic: /points
  range_noise: 0.02
  min_range: 1.5
  max_range: 60
  scan_period: 0.05
  point_time: {field: stamp_us, unit: us, stamp: last}
)",
                                 "r");
  EXPECT_EQ(rig.lidar->min_range_m, 1.5);
  EXPECT_EQ(rig.lidar->max_range_m, 60.0);
  EXPECT_EQ(rig.lidar->scan_period_s, 0.05);
  EXPECT_EQ(rig.lidar->point_time.field, "stamp_us");
  EXPECT_EQ(rig.lidar->point_time.unit, "us");
  EXPECT_EQ(rig.lidar->point_time.stamp, "last");
  expectRefusal(kImu + "lidar: {topic: /p, range_noise: 0.02, point_time: {unit: h}}",
                {"lidar: point_time: unit", "= h"});
  expectRefusal(kImu + "lidar: {topic: /p, range_noise: 0.02, min_range: 9, max_range: 3}", {"below max_range"});
}

TEST(RigFile, UnknownKeysAreRefusedWithTheNearestKnown) {
  expectRefusal(replaced(kFull, "gyroscope_noise_density", "gyroscope_noise_desnity"),
                {"'imu: gyroscope_noise_density': is missing", "'gyroscope_noise_desnity'"});
  expectRefusal(kImu + kLidar + "camra: {}\n", {"'camra'", "unknown key", "did you mean 'camera'"});
  expectRefusal(replaced(kFull, "range_noise: 0.03", "range_noise: 0.03, rangenoise: 0.03"),
                {"lidar: rangenoise", "did you mean 'range_noise'"});
  expectRefusal(kFull + "colour: blue\n", {"'colour' = blue", "unknown key; known: camera | imu"});
  expectRefusal(replaced(kFull, "info_topic", "infotopic"), {"camera: infotopic", "did you mean 'info_topic'"});
}

TEST(RigFile, WrongOrdersOfMagnitudeAreRefusedWithTheRange) {
  expectRefusal(replaced(kFull, "1.745e-4", "36.0"),
                {"line 4", "'imu: gyroscope_noise_density' = 36.0", "[1e-06, 0.1] rad/s/sqrt(Hz)"});
  expectRefusal(replaced(kFull, "5.884e-4", "60"), {"accelerometer_noise_density", "m/s^2/sqrt(Hz)"});
  expectRefusal(replaced(kFull, "1.0e-6", "0"), {"gyroscope_random_walk", "[1e-09, 0.1]"});
  expectRefusal(replaced(kFull, "1.0e-6", ".nan"), {"gyroscope_random_walk"});
  expectRefusal(replaced(kFull, "range_noise: 0.03", "range_noise: 30"), {"lidar: range_noise", "[0.0001, 1] m"});
  expectRefusal(replaced(kFull, "square: 0.10", "square: 100"), {"target: square", "[0.005, 1] m"});
}

TEST(RigFile, WrongTypesAndImpossibleNumbersAreRefused) {
  expectRefusal(replaced(kFull, "1.745e-4", "small"), {"gyroscope_noise_density' = small", "must be a number"});
  expectRefusal(replaced(kFull, "1.745e-4", "[1, 2]"), {"gyroscope_noise_density' = [...]", "must be a number"});
  expectRefusal(replaced(kFull, "cols: 8", "cols: 8.5"), {"target: cols", "whole number in [3, 50]"});
  expectRefusal(replaced(kFull, "checkerboard", "apriltag"), {"target: type", "apriltag", "checkerboard"});
  expectRefusal(replaced(kFull, "board_width: 1.0", "board_width: 0.5"), {"target: board_width", "0.7"});
  expectRefusal(replaced(kFull, "/imu/data", "\"imu data\""), {"imu: topic", "topic name"});
  expectRefusal(replaced(kFull, "frame: lidar_link", "frame: /lidar_link"), {"lidar: frame", "'/'"});
  expectRefusal(replaced(kFull, "/velodyne_points", "/imu/data"), {"'imu: topic' and 'lidar: topic' are both"});
  expectRefusal(replaced(kFull, "lidar_link", "imu_link"), {"'imu: frame' and 'lidar: frame' are both"});
  expectRefusal(kImu + kCamera + "lidar:\n", {"'lidar'", "is empty"});
  expectRefusal(kImu + kCamera + "lidar: velodyne\n", {"'lidar' must be a mapping"});
  expectRefusal(kFull + "initial_guess: {T_imu_lidar: {rotation_xyzw: [1, 1, 1, 1]}}", {"rotation_xyzw", "length 1"});
  expectRefusal(kFull + "initial_guess: {T_imu_lidar: {translation: [1, 1]}}", {"translation", "3 numbers"});
  expectRefusal(kFull + "initial_guess: {T_imu_lidar: {translation: [1, 1, 1e4]}}", {"translation", "100 m"});
  expectRefusal(kFull + "initial_guess: {T_camera_imu: {}}", {"T_camera_imu", "known: T_imu_camera | T_imu_lidar"});
}

TEST(RigFile, WhatIsNoRigFileIsRefused) {
  expectRefusal("", {"mapping"});
  expectRefusal("just words", {"mapping"});
  expectRefusal("imu: [unclosed", {"no valid YAML"});
  expectRefusal(kFull + kCamera, {"'camera'", "stands twice"});
  expectRefusal(std::string(5000, '['), {"my_rig.yaml"});
  try {
    parseRig(kFull + "\"camara\\nleft\": {}", "my_rig.yaml");
    ADD_FAILURE() << "taken";
  } catch (const std::runtime_error& refusal) {
    EXPECT_EQ(std::string(refusal.what()).find('\n'), std::string::npos) << refusal.what();
  }
  EXPECT_THROW(loadRigFile("no_such_rig.yaml"), std::runtime_error);
  EXPECT_THROW(loadRigFile("cfg"), std::runtime_error);
}

TEST(RigFile, TheRigsOfThePackageAreGood) {
  EXPECT_TRUE(loadRigFile("cfg/rigs/template.yaml").target);
  const RigConfig table1 = loadRigFile("cfg/rigs/table1.yaml");
  EXPECT_TRUE(table1.camera && table1.lidar && table1.target);
  EXPECT_TRUE(loadRigFile("cfg/rigs/euroc.yaml").camera->model);
  EXPECT_EQ(loadRigFile("cfg/rigs/acfr.yaml").target->cols, 5);
  EXPECT_FALSE(loadRigFile("cfg/rigs/maplab.yaml").camera);
}

TEST(RigFile, GoesOnFromAnEarlierResult) {
  CalibrationEstimate earlier;
  earlier.status = Status::kConverging;
  earlier.lidar.valid = true;
  earlier.calibration.T_imu_lidar.t = {0.1, 0.2, 0.3};
  earlier.covariance.diagonal().setConstant(1e-6);
  const std::string path = testing::TempDir() + "rig_file_test_calibration.yaml";
  writeFileAtomically(path, formatResult(earlier, {true, true}));
  RigConfig rig = parseRig(kFull, "my_rig.yaml");
  goOnFrom(path, &rig);
  ASSERT_TRUE(rig.guess_T_imu_lidar);
  EXPECT_EQ(rig.guess_T_imu_lidar->t, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_FALSE(rig.guess_T_imu_camera);
  ASSERT_TRUE(rig.earlier);
  EXPECT_EQ(rig.earlier->covariance(6, 6), 1e-6);

  const auto refused = [&](const CalibrationEstimate& estimate) {
    writeFileAtomically(path, formatResult(estimate, {true, true}));
    try {
      goOnFrom(path, &rig);
    } catch (const std::runtime_error& error) {
      return std::string(error.what()).find(path) == 0;
    }
    return false;
  };
  CalibrationEstimate nothing = earlier;
  nothing.status = Status::kInsufficientData;
  EXPECT_TRUE(refused(nothing));
  CalibrationEstimate impossible = earlier;
  impossible.covariance(7, 7) = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(refused(impossible));
  std::remove(path.c_str());
}

}  // namespace
}  // namespace cocalib
