#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <map>
#include <set>
#include <sstream>
#include <stdexcept>

#include "cocalib/sim/scenario.h"

namespace cocalib::sim {
namespace {

template <typename T>
std::string namesOf(const std::map<std::string, T>& table) {
  std::string names;
  for (const auto& [name, value] : table) names += (names.empty() ? "" : ", ") + name;
  return names;
}

/// One block of the file. Reads what is there, leaves alone what is not, and refuses what nobody asked for.
class Block {
 public:
  Block(YAML::Node node, std::string prefix) : node_(std::move(node)), prefix_(std::move(prefix)) {
    if (node_ && !node_.IsNull() && !node_.IsMap()) fail(prefix_.empty() ? "file" : prefix_, "must hold 'key: value'");
  }

  template <typename T>
  void read(const std::string& key, T& value, const char* what) {
    const YAML::Node node = find(key);
    if (!node) return;
    try {
      value = node.as<T>();
    } catch (const YAML::Exception&) {
      fail(prefix_ + key, std::string("must be ") + what);
    }
  }

  void read(const std::string& key, double& value) { read(key, value, "a number"); }
  void read(const std::string& key, int& value) { read(key, value, "a whole number"); }
  void read(const std::string& key, bool& value) { read(key, value, "true or false"); }

  void readTopic(const std::string& key, std::string& value) {
    read(key, value, "text");
    if (value.empty()) fail(prefix_ + key, "must not be empty");
  }

  /// A list of exactly `count` numbers; any length if `count` is negative.
  void read(const std::string& key, std::vector<double>& values, int count) {
    if (!find(key)) return;
    const std::string what = count < 0 ? "a list of numbers" : "a list of " + std::to_string(count) + " numbers";
    read(key, values, what.c_str());
    if (count >= 0 && values.size() != static_cast<std::size_t>(count)) fail(prefix_ + key, "must be " + what);
  }

  template <int N>
  void read(const std::string& key, Eigen::Matrix<double, N, 1>& value) {
    std::vector<double> values(value.data(), value.data() + N);
    read(key, values, N);
    value = Eigen::Map<const Eigen::Matrix<double, N, 1>>(values.data());
  }

  template <typename T>
  void readChoice(const std::string& key, T& value, const std::map<std::string, T>& choices) {
    std::string name;
    if (!find(key)) return;
    read(key, name, "text");
    const auto choice = choices.find(name);
    if (choice == choices.end()) fail(prefix_ + key, "'" + name + "' is not one of " + namesOf(choices));
    value = choice->second;
  }

  Block block(const std::string& key) { return {find(key), prefix_ + key + "."}; }

  /// @throws std::runtime_error if the file has a key that was never read
  void finish() const {
    if (!node_ || !node_.IsMap()) return;
    for (const auto& entry : node_) {
      const std::string key = entry.first.as<std::string>("?");
      if (known_.count(key) != 0) continue;
      std::string names;
      for (const std::string& name : known_) names += (names.empty() ? "" : ", ") + name;
      fail(prefix_ + key, "unknown key; known here: " + names);
    }
  }

 private:
  YAML::Node find(const std::string& key) {
    known_.insert(key);
    if (!node_ || !node_.IsMap()) return YAML::Node(YAML::NodeType::Undefined);
    return static_cast<const YAML::Node&>(node_)[key];
  }
  [[noreturn]] static void fail(const std::string& key, const std::string& message) {
    throw std::invalid_argument(key + ": " + message);
  }

  YAML::Node node_;
  std::string prefix_;
  std::set<std::string> known_;
};

void readImu(Block block, Scenario& scenario) {
  Scenario::Imu& imu = scenario.imu;
  block.readTopic("topic", scenario.imu_topic);
  block.readTopic("frame", scenario.imu_frame);
  block.read("rate", imu.rate_hz);
  block.read("gyroscope_noise_density", imu.gyro_noise_density);
  block.read("accelerometer_noise_density", imu.accel_noise_density);
  block.read("gyroscope_bias", imu.gyro_bias);
  block.read("accelerometer_bias", imu.accel_bias);
  block.read("gyroscope_random_walk", imu.gyro_bias_walk);
  block.read("accelerometer_random_walk", imu.accel_bias_walk);
  block.finish();
}

void readFaults(Block block, Scenario::Camera::Faults& faults) {
  Eigen::Vector2d blackout(faults.blackout_start_s, faults.blackout_s);
  block.read("blackout", blackout);
  faults.blackout_start_s = blackout[0];
  faults.blackout_s = blackout[1];
  block.read("brightness_period", faults.brightness_period_s);
  block.read("brightness_factor", faults.brightness_factor);
  block.read("dropped", faults.dropped);
  block.read("moving_object", faults.moving_object);
  block.finish();
}

void readCamera(Block block, Scenario::Camera& camera) {
  block.read("present", camera.present);
  block.readTopic("topic", camera.topic);
  block.readTopic("info_topic", camera.info_topic);
  block.readTopic("frame", camera.frame);
  block.read("rate", camera.rate_hz);
  block.readChoice("model", camera.model,
                   {{"pinhole-radtan", std::string("pinhole-radtan")}, {"pinhole-equi", std::string("pinhole-equi")}});
  block.read("intrinsics", camera.intrinsics);
  block.read("distortion", camera.distortion, -1);
  std::vector<double> resolution{static_cast<double>(camera.width), static_cast<double>(camera.height)};
  block.read("resolution", resolution, 2);
  camera.width = static_cast<int>(resolution[0]);
  camera.height = static_cast<int>(resolution[1]);
  block.read("mounting_rpy", camera.mounting_rpy);
  block.read("optical_roll", camera.optical_roll);
  block.read("translation", camera.translation);
  block.read("time_offset", camera.time_offset_s);
  block.read("blur", camera.blur_px);
  block.read("noise", camera.noise);
  block.read("exposure", camera.exposure_s);
  block.read("line_delay", camera.line_delay_s);
  block.readChoice("transport", camera.transport,
                   {{"raw", std::string("raw")}, {"jpeg", std::string("jpeg")}, {"png", std::string("png")}});
  readFaults(block.block("faults"), camera.faults);
  block.read("corner_noise", camera.corner_noise_px);
  block.read("track_noise", camera.track_noise_px);
  block.finish();
}

void readLidar(Block block, Scenario::Lidar& lidar) {
  block.readTopic("topic", lidar.topic);
  block.readTopic("frame", lidar.frame);
  block.readChoice("model", lidar.model,
                   {{"vlp16", LidarModel::kVlp16},
                    {"os1_32", LidarModel::kOs1_32},
                    {"os1_64", LidarModel::kOs1_64},
                    {"os1_128", LidarModel::kOs1_128},
                    {"xt32", LidarModel::kXt32},
                    {"rs32", LidarModel::kRs32},
                    {"livox", LidarModel::kLivox}});
  block.readChoice("dialect", lidar.dialect,
                   {{"velodyne", CloudDialect::kVelodyne},
                    {"ouster", CloudDialect::kOuster},
                    {"hesai", CloudDialect::kHesai},
                    {"robosense", CloudDialect::kRobosense},
                    {"livox", CloudDialect::kLivox},
                    {"livox_offset", CloudDialect::kLivoxOffset},
                    {"no_time", CloudDialect::kNoTime}});
  block.read("rate", lidar.rate_hz);
  block.read("range_noise", lidar.range_noise_m);
  block.read("min_range", lidar.min_range_m);
  block.read("max_range", lidar.max_range_m);
  block.read("max_incidence", lidar.max_incidence_rad);
  block.read("keep_no_return", lidar.keep_no_return);
  block.read("mounting_rpy", lidar.mounting_rpy);
  block.read("translation", lidar.translation);
  block.read("time_offset", lidar.time_offset_s);
  block.finish();
}

void readBoard(Block block, Scenario::Board& board) {
  block.read("present", board.present);
  block.read("cols", board.cols);
  block.read("rows", board.rows);
  block.read("square", board.square_m);
  block.read("width", board.width_m);
  block.read("height", board.height_m);
  block.read("distance", board.distance_m);
  block.read("tilt_rpy", board.tilt_rpy);
  block.finish();
}

Scenario readScenario(const YAML::Node& root) {
  Scenario scenario;
  Block block(root, "");
  block.read("name", scenario.name, "text");
  block.read("seed", scenario.seed, "a whole number >= 0");
  block.read("duration", scenario.duration_s);
  block.read("gravity", scenario.gravity);
  block.read("ramp", scenario.ramp_s);
  block.read("planar_for", scenario.planar_for_s);
  block.read("parked_after", scenario.parked_after_s);
  block.readChoice(
      "place", scenario.place,
      {{"room", Place::kRoom}, {"corridor", Place::kCorridor}, {"wall", Place::kWall}, {"building", Place::kBuilding}});
  block.readChoice("motion", scenario.motion,
                   {{"full", Motion::kFull},
                    {"mild", Motion::kMild},
                    {"planar", Motion::kPlanar},
                    {"upright", Motion::kUpright},
                    {"rotation_only", Motion::kRotationOnly},
                    {"translation_only", Motion::kTranslationOnly},
                    {"static", Motion::kStatic}});
  readImu(block.block("imu"), scenario);
  readCamera(block.block("camera"), scenario.camera);
  readLidar(block.block("lidar"), scenario.lidar);
  readBoard(block.block("board"), scenario.board);
  block.finish();
  scenario.validate();
  return scenario;
}

}  // namespace

Scenario parseScenario(const std::string& yaml, const std::string& path) {
  std::string why;
  try {
    return readScenario(YAML::Load(yaml));
  } catch (const YAML::Exception& error) {
    why = "line " + std::to_string(error.mark.line + 1) + ": " + error.msg;
  } catch (const std::invalid_argument& error) {
    why = error.what();
  }
  std::replace(why.begin(), why.end(), '\n', ' ');  // a key may hold a line break
  throw std::runtime_error(path + ": " + why);
}

Scenario loadScenario(const std::string& path) {
  std::ifstream file(path);
  if (!file) throw std::runtime_error(path + ": cannot be opened; give the path of a scenario file (cfg/scenarios/)");
  const std::string text((std::istreambuf_iterator<char>(file)), std::istreambuf_iterator<char>());
  return parseScenario(text, path);
}

}  // namespace cocalib::sim
