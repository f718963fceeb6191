#include "cocalib/sim/truth_file.h"

#include <gtest/gtest.h>
#include <yaml-cpp/yaml.h>

#include "cocalib/io/rig_file.h"
#include "cocalib/sim/imu.h"

namespace cocalib::sim {
namespace {

Pose poseOf(const YAML::Node& node) {
  const auto t = node["translation"].as<std::vector<double>>(), q = node["rotation_xyzw"].as<std::vector<double>>();
  return {Eigen::Quaterniond(q.at(3), q.at(0), q.at(1), q.at(2)), {t.at(0), t.at(1), t.at(2)}};
}

TEST(TruthFile, HoldsWhatWasSimulated) {
  Scenario scenario;
  scenario.duration_s = 2.0;
  scenario.camera.time_offset_s = 0.02;
  const Scene scene(scenario);
  const Trajectory trajectory(scenario);
  const YAML::Node truth = YAML::Load(truthText(scenario, scene, trajectory));
  EXPECT_LT(poseOf(truth["camera"]["T_imu_camera"]).minus(scenario.camera.T_imu_camera()).norm(), 1e-10);
  EXPECT_LT(poseOf(truth["lidar"]["T_imu_lidar"]).minus(scenario.lidar.T_imu_lidar()).norm(), 1e-10);
  EXPECT_LT(poseOf(truth["board"]["T_world_board"]).minus(scene.T_W_B()).norm(), 1e-10);
  const Pose T_L_C = scenario.lidar.T_imu_lidar().inverse() * scenario.camera.T_imu_camera();
  EXPECT_LT(poseOf(truth["lidar_camera"]["T_lidar_camera"]).minus(T_L_C).norm(), 1e-10);
  EXPECT_EQ(truth["camera"]["time_offset"].as<double>(), 0.02);
  EXPECT_NEAR(truth["imu"]["gyroscope_bias"][1].as<double>(), trueImuBias(scenario).gyro.y(), 1e-15);
  EXPECT_EQ(truth["trajectory"].size(), 21U);
  EXPECT_EQ(truth["trajectory"][20][0].as<std::string>(), "1700000002.000000000");
}

TEST(RigFile, OfEveryKindOfRecordingIsAccepted) {
  for (const char* name : {"table1_full", "ouster32", "livox", "no_time_field", "compressed", "static"}) {
    const Scenario scenario = loadScenario(std::string("cfg/scenarios/") + name + ".yaml");
    const RigConfig rig = parseRig(rigText(scenario), name);
    EXPECT_EQ(rig.imu.topic, scenario.imu_topic);
    EXPECT_EQ(rig.lidar->topic, scenario.lidar.topic);
    EXPECT_EQ(rig.camera->info_topic, scenario.camera.info_topic);
    EXPECT_EQ(rig.target->cols, scenario.board.cols);
    EXPECT_DOUBLE_EQ(*rig.target->height_m, scenario.board.height_m);
    EXPECT_FALSE(rig.guess_T_imu_camera || rig.guess_T_imu_lidar);
  }
}

TEST(RigFile, OfNoiseFreeSensorsIsAcceptedToo) {
  Scenario scenario;
  scenario.imu.gyro_noise_density = scenario.imu.accel_noise_density = 0.0;
  scenario.lidar.range_noise_m = 0.0;
  scenario.board.present = false;
  const RigConfig rig = parseRig(rigText(scenario), "noise-free");
  EXPECT_GT(rig.imu.noise.gyro_noise_density, 0.0);
  EXPECT_FALSE(rig.target.has_value());
}

}  // namespace
}  // namespace cocalib::sim
