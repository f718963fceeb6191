#include "cocalib/io/rig_file.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cctype>
#include <cmath>
#include <fstream>
#include <iterator>
#include <stdexcept>

#include "cocalib/estimation/calibration_prior.h"
#include "cocalib/io/result_file.h"
#include "yaml_section.h"

namespace cocalib {
namespace {

constexpr std::size_t kLargestFile = 1U << 20U;  // bytes; rig files have one or two thousand

std::string readTopic(YamlSection* section, const std::string& key) {
  const std::string topic = section->text(key);
  const bool legal = std::all_of(topic.begin(), topic.end(),
                                 [](unsigned char c) { return std::isalnum(c) != 0 || c == '/' || c == '_'; });
  if (!legal || topic.back() == '/' || topic.find("//") != std::string::npos) {
    section->fail(key, "is no topic name (letters, digits, _ and /, as `rosbag info` shows it)");
  }
  return topic;
}

std::string readFrame(YamlSection* section, const std::string& fallback) {
  if (!section->has("frame")) return fallback;
  const std::string frame = section->text("frame");
  if (frame.front() == '/') section->fail("frame", "must not begin with '/' (tf2 refuses it)");
  if (frame.find_first_of(" \t\n") != std::string::npos) section->fail("frame", "must not hold blanks");
  return frame;
}

// The ranges are an order of magnitude wider than any IMU sold, at either end; what lies outside is another unit.
RigConfig::Imu readImu(YamlSection section) {
  RigConfig::Imu imu;
  imu.topic = readTopic(&section, "topic");
  imu.frame = readFrame(&section, imu.frame);
  imu.noise.gyro_noise_density = section.number("gyroscope_noise_density", 1e-6, 1e-1, "rad/s/sqrt(Hz)");
  imu.noise.gyro_bias_walk = section.number("gyroscope_random_walk", 1e-9, 1e-1, "rad/s^2/sqrt(Hz)");
  imu.noise.accel_noise_density = section.number("accelerometer_noise_density", 1e-6, 1.0, "m/s^2/sqrt(Hz)");
  imu.noise.accel_bias_walk = section.number("accelerometer_random_walk", 1e-8, 1.0, "m/s^3/sqrt(Hz)");
  section.finish();
  return imu;
}

CameraModel readCameraModel(YamlSection* section) {
  const std::string name = section->word("model", {"pinhole-radtan", "pinhole-equi"});
  const std::vector<double> resolution = section->numbers("resolution", 2);
  for (const double side : resolution) {
    if (!(side >= 16.0 && side <= 65536.0) || side != std::floor(side)) {
      section->fail("resolution", "must be [width, height], whole numbers in [16, 65536] px");
    }
  }
  const std::vector<double> k = section->numbers("intrinsics", 4);
  for (int i = 0; i < 2; ++i) {
    const auto axis = static_cast<std::size_t>(i);
    if (!(k[axis] >= 10.0 && k[axis] <= 1e5)) section->fail("intrinsics", "fu and fv must be in [10, 1e5] px");
    if (!(k[axis + 2] > 0.0 && k[axis + 2] < resolution[axis])) {
      section->fail("intrinsics", "must be [fu, fv, cu, cv], with (cu, cv) inside the picture");
    }
  }
  const std::vector<double> distortion = section->numbers("distortion", -1);
  try {
    return CameraModel::fromName(name, {k[0], k[1], k[2], k[3]}, distortion, static_cast<int>(resolution[0]),
                                 static_cast<int>(resolution[1]));
  } catch (const std::invalid_argument& error) {
    section->fail("distortion", error.what());
  }
}

RigConfig::Camera readCamera(YamlSection section) {
  RigConfig::Camera camera;
  camera.topic = readTopic(&section, "topic");
  camera.frame = readFrame(&section, camera.frame);
  const bool has_info = section.has("info_topic");
  bool has_model = false;
  for (const char* key : {"model", "intrinsics", "distortion", "resolution"}) has_model |= section.has(key);
  if (has_info && has_model) section.fail("info_topic", "give either it or model, intrinsics, distortion, resolution");
  if (!has_info && !has_model) {
    section.finish();  // a misspelt key explains it better
    section.fail("info_topic", "is missing (or model, intrinsics, distortion, resolution in place of it)");
  }
  if (has_info) {
    camera.info_topic = readTopic(&section, "info_topic");
  } else {
    camera.model = readCameraModel(&section);
  }
  section.finish();
  return camera;
}

PointTimeOverride readPointTime(YamlSection section) {
  PointTimeOverride point_time;
  if (section.has("field")) point_time.field = section.text("field");
  if (section.has("unit")) point_time.unit = section.word("unit", {"s", "ms", "us", "ns"});
  if (section.has("stamp")) point_time.stamp = section.word("stamp", {"first", "last"});
  section.finish();
  return point_time;
}

RigConfig::Lidar readLidar(YamlSection section) {
  RigConfig::Lidar lidar;
  lidar.topic = readTopic(&section, "topic");
  lidar.frame = readFrame(&section, lidar.frame);
  lidar.range_noise_m = section.number("range_noise", 1e-4, 1.0, "m");
  lidar.min_range_m = section.numberOr("min_range", 0.0, 100.0, "m", lidar.min_range_m);
  lidar.max_range_m = section.numberOr("max_range", 1.0, 1e4, "m", lidar.max_range_m);
  if (lidar.min_range_m >= lidar.max_range_m) section.fail("min_range", "must be below max_range");
  lidar.scan_period_s = section.numberOr("scan_period", 5e-3, 1.5, "s", lidar.scan_period_s);
  if (section.has("point_time")) lidar.point_time = readPointTime(section.section("point_time"));
  section.finish();
  return lidar;
}

BoardGeometry readTarget(YamlSection section) {
  BoardGeometry board;
  section.word("type", {"checkerboard"});
  board.cols = section.integer("cols", 3, 50);
  board.rows = section.integer("rows", 3, 50);
  board.square_m = section.number("square", 5e-3, 1.0, "m");
  const auto side = [&section, &board](const char* key, int corners) -> std::optional<double> {
    if (!section.has(key)) return std::nullopt;
    const double inner = (corners - 1) * board.square_m;  // the plate must at least carry its corners
    const double length = section.number(key, 0.0, 10.0, "m");
    if (length <= inner) {
      section.fail(key, "must exceed the " + std::to_string(inner) + " m between the outermost inner corners");
    }
    return length;
  };
  board.width_m = side("board_width", board.cols);
  board.height_m = side("board_height", board.rows);
  section.finish();
  return board;
}

Pose readPose(YamlSection section) {
  Pose pose;
  if (section.has("translation")) {
    const std::vector<double> t = section.numbers("translation", 3);
    pose.t = Eigen::Vector3d(t[0], t[1], t[2]);
    if (pose.t.norm() > 100.0) section.fail("translation", "must be shorter than 100 m");
  }
  if (section.has("rotation_xyzw")) {
    const std::vector<double> q = section.numbers("rotation_xyzw", 4);
    pose.q.coeffs() = Eigen::Vector4d(q[0], q[1], q[2], q[3]);
    if (std::abs(pose.q.norm() - 1.0) > 0.01) section.fail("rotation_xyzw", "must have length 1 (within 0.01)");
    pose.q.normalize();
  }
  section.finish();
  return pose;
}

void readInitialGuess(YamlSection section, RigConfig* rig) {
  if (section.has("T_imu_camera")) rig->guess_T_imu_camera = readPose(section.section("T_imu_camera"));
  if (section.has("T_imu_lidar")) rig->guess_T_imu_lidar = readPose(section.section("T_imu_lidar"));
  section.finish();
}

/// Two sensors cannot speak on one topic, nor stand in one frame.
void checkDistinct(const RigConfig& rig) {
  std::vector<std::pair<std::string, std::string>> topics{{"imu: topic", rig.imu.topic}};
  std::vector<std::pair<std::string, std::string>> frames{{"imu: frame", rig.imu.frame}};
  if (rig.camera) {
    topics.emplace_back("camera: topic", rig.camera->topic);
    if (!rig.camera->info_topic.empty()) topics.emplace_back("camera: info_topic", rig.camera->info_topic);
    frames.emplace_back("camera: frame", rig.camera->frame);
  }
  if (rig.lidar) {
    topics.emplace_back("lidar: topic", rig.lidar->topic);
    frames.emplace_back("lidar: frame", rig.lidar->frame);
  }
  for (const auto* list : {&topics, &frames}) {
    for (auto a = list->begin(); a != list->end(); ++a) {
      for (auto b = std::next(a); b != list->end(); ++b) {
        if (a->second != b->second) continue;
        throw YamlError(rig.file + ": '" + a->first + "' and '" + b->first + "' are both " + a->second);
      }
    }
  }
}

RigConfig readRig(const YAML::Node& root, const std::string& path) {
  YamlSection top(root, path, "");
  RigConfig rig;
  rig.file = path;
  for (const char* key : {"imu", "camera", "lidar", "target", "initial_guess"}) top.has(key);
  top.finish();  // first, so that a misspelt section is named as such and not as missing
  rig.imu = readImu(top.section("imu"));
  if (top.has("camera")) rig.camera = readCamera(top.section("camera"));
  if (top.has("lidar")) rig.lidar = readLidar(top.section("lidar"));
  if (top.has("target")) rig.target = readTarget(top.section("target"));
  if (top.has("initial_guess")) readInitialGuess(top.section("initial_guess"), &rig);
  if (!rig.camera && !rig.lidar) throw YamlError(path + ": has neither 'camera' nor 'lidar': nothing to calibrate");
  checkDistinct(rig);
  return rig;
}

}  // namespace

RigConfig parseRig(const std::string& yaml, const std::string& path) {
  try {
    RigConfig rig = readRig(YAML::Load(yaml), path);
    rig.text = yaml;
    return rig;
  } catch (const YAML::Exception& error) {
    throw YamlError(path + " line " + std::to_string(error.mark.line + 1) + ": no valid YAML: " + error.msg);
  }
}

void goOnFrom(const std::string& result_path, RigConfig* rig) {
  const CalibrationEstimate earlier = loadResult(result_path);
  const auto refuse = [&result_path](const std::string& why) {
    throw YamlError(result_path + ": " + why + "; give the calibration.yaml of a run that found something");
  };
  const bool camera = rig->camera && earlier.camera.valid, lidar = rig->lidar && earlier.lidar.valid;
  if (earlier.status == Status::kInsufficientData || (!camera && !lidar))
    refuse("holds nothing about this rig's sensors");
  // What it holds must be a covariance: its inverse goes into every solve.
  const Matrix14d covariance = priorFrom(earlier).covariance;
  const bool symmetric = covariance.allFinite() && covariance.isApprox(covariance.transpose(), 1e-6);
  if (!symmetric || covariance.llt().info() != Eigen::Success) refuse("its joint_covariance is none");
  if (camera) rig->guess_T_imu_camera = earlier.calibration.T_imu_camera;
  if (lidar) rig->guess_T_imu_lidar = earlier.calibration.T_imu_lidar;
  rig->earlier = earlier;
}

RigConfig loadRigFile(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw YamlError(path + ": cannot be opened; give the path of a rig file (see cfg/rigs/template.yaml)");
  std::string text;
  for (std::istreambuf_iterator<char> it(file), end; it != end && text.size() <= kLargestFile; ++it) text += *it;
  if (file.bad()) throw YamlError(path + ": cannot be read");
  if (text.size() > kLargestFile) throw YamlError(path + ": is no rig file (larger than 1 MiB)");
  return parseRig(text, path);
}

}  // namespace cocalib
