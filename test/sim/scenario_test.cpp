#include "cocalib/sim/scenario.h"

#include <gtest/gtest.h>

#include <fstream>
#include <set>
#include <sstream>
#include <stdexcept>

namespace cocalib::sim {
namespace {

std::string errorOf(const std::string& yaml) {
  try {
    parseScenario(yaml, "some.yaml");
  } catch (const std::runtime_error& error) {
    return error.what();
  }
  return "";
}

void expectError(const std::string& yaml, const std::vector<std::string>& parts) {
  const std::string error = errorOf(yaml);
  for (const std::string& part : parts) EXPECT_NE(error.find(part), std::string::npos) << yaml << " -> " << error;
  EXPECT_EQ(error.find('\n'), std::string::npos) << error;
}

TEST(Scenario, ErrorsNameFileKeyAndWhatIsAllowed) {
  expectError("camera: {rate: 0}", {"some.yaml", "camera.rate", "[1, 200] Hz"});
  expectError("camera: {rate: fast}", {"some.yaml", "camera.rate", "a number"});
  expectError("camera: {rat: 50}", {"some.yaml", "camera.rat", "unknown key", "rate"});
  expectError("lidars: {rate: 10}", {"some.yaml", "lidars", "unknown key", "lidar"});
  expectError("lidar: {model: hdl64}", {"some.yaml", "lidar.model", "hdl64", "vlp16"});
  expectError("lidar: {time_offset: 20}", {"some.yaml", "lidar.time_offset", "[-0.1, 0.1] s"});
  expectError("motion: [1]", {"some.yaml", "motion", "text"});
  expectError("motion: wild", {"some.yaml", "motion", "planar"});
  expectError("camera: {intrinsics: [1, 2]}", {"some.yaml", "camera.intrinsics", "4 numbers"});
  expectError("camera: {intrinsics: [-1, 460, 375, 239]}", {"some.yaml", "camera"});
  expectError("board: {width: 0.5}", {"some.yaml", "board.width", "[0.9, 3] m"});
  expectError("duration: .nan", {"some.yaml", "duration"});
  expectError("camera: {faults: {dropped: 2}}", {"some.yaml", "camera.faults.dropped", "[0, 0.9]"});
  expectError("camera: {faults: {blackout: 3}}", {"some.yaml", "camera.faults.blackout", "2 numbers"});
  expectError("camera: 3", {"some.yaml", "camera"});
  expectError("camera: {topic: ''}", {"some.yaml", "camera.topic"});
  expectError("camera: {rate: 50", {"some.yaml", "line"});
  expectError("- 1\n- 2", {"some.yaml", "key: value"});
}

TEST(Scenario, MissingFileIsNamed) {
  try {
    loadScenario("/nowhere/at_all.yaml");
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/at_all.yaml"), std::string::npos);
  }
}

TEST(Scenario, EveryShippedScenarioLoads) {
  const std::set<std::string> names = {
      "table1_full", "table1_mild",  "planar",      "upright",  "rotation_only",  "translation_only",
      "static",      "time_offsets", "upside_down", "sideways", "ouster32",       "ouster64",
      "ouster128",   "hesai",        "robosense",   "livox",    "no_time_field",  "rolling_shutter",
      "motion_blur", "compressed",   "lidar_only",  "building", "picture_faults", "planar_then_full",
      "parked"};
  for (const std::string& name : names) {
    const Scenario scenario = loadScenario("cfg/scenarios/" + name + ".yaml");
    EXPECT_EQ(scenario.name, name);
  }
}

// table1_full.yaml repeats the defaults for the reader.
TEST(Scenario, FullFileAgreesWithTheDefaults) {
  const Scenario file = loadScenario("cfg/scenarios/table1_full.yaml"), code;
  EXPECT_EQ(file.duration_s, code.duration_s);
  EXPECT_EQ(file.imu.gyro_noise_density, code.imu.gyro_noise_density);
  EXPECT_EQ(file.imu.accel_noise_density, code.imu.accel_noise_density);
  EXPECT_EQ(file.imu.gyro_bias, code.imu.gyro_bias);
  EXPECT_EQ(file.imu.accel_bias, code.imu.accel_bias);
  EXPECT_EQ(file.camera.intrinsics, code.camera.intrinsics);
  EXPECT_EQ(file.camera.distortion, code.camera.distortion);
  EXPECT_EQ(file.camera.mounting_rpy, code.camera.mounting_rpy);
  EXPECT_EQ(file.camera.translation, code.camera.translation);
  EXPECT_EQ(file.camera.noise, code.camera.noise);
  EXPECT_EQ(file.lidar.mounting_rpy, code.lidar.mounting_rpy);
  EXPECT_EQ(file.lidar.translation, code.lidar.translation);
  EXPECT_EQ(file.lidar.max_incidence_rad, code.lidar.max_incidence_rad);
  EXPECT_EQ(file.board.tilt_rpy, code.board.tilt_rpy);
  EXPECT_EQ(file.camera.topic, code.camera.topic);
  EXPECT_EQ(file.lidar.topic, code.lidar.topic);
}

TEST(Scenario, MountingsAreThoseOfTheTable) {
  const Scenario scenario;
  // The optical axis of a camera whose body looks along x of the IMU, turned by pitch and yaw: x of rpy (-0.16, -0.16,
  // -0.04).
  const Eigen::Vector3d axis = scenario.camera.T_imu_camera().q * Eigen::Vector3d::UnitZ();
  const Eigen::Vector3d expected(std::cos(-0.16) * std::cos(-0.04), std::cos(-0.16) * std::sin(-0.04), std::sin(0.16));
  EXPECT_LT((axis - expected).norm(), 1e-12);
  EXPECT_EQ(scenario.lidar.T_imu_lidar().t, Eigen::Vector3d(0.1, 0.0, -0.08));
}

}  // namespace
}  // namespace cocalib::sim
