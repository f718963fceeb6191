#include "cocalib/sim/camera.h"

#include <gtest/gtest.h>

#include <map>

namespace cocalib::sim {
namespace {

TEST(SimulatedCamera, BoardIsSeenInMostPicturesAndItsFrameIsUpright) {
  const Scenario scenario;
  const Scene scene(scenario);
  const Trajectory trajectory(scenario);
  int complete = 0, pictures = 0;
  for (int k = 0; k < imageCount(scenario); k += 10) {
    const BoardTruth truth = trueBoard(scenario, scene, trajectory, k);
    EXPECT_EQ(simulateBoard(scenario, scene, trajectory, k).has_value(), truth.complete);
    ++pictures;
    complete += truth.complete ? 1 : 0;
  }
  EXPECT_EQ(pictures, 300);
  EXPECT_GT(complete, 100);
  // y of the board points down, z away from the rig, the origin is the upper left corner.
  EXPECT_LT((scene.T_W_B().q * Eigen::Vector3d::UnitY()).z(), -0.9);
  EXPECT_GT((scene.T_W_B().q * Eigen::Vector3d::UnitZ()).x(), 0.8);
  const BoardTruth first = trueBoard(scenario, scene, trajectory, 0);
  EXPECT_LT(first.corners_px.front().x(), first.corners_px.back().x());
  EXPECT_LT(first.corners_px.front().y(), first.corners_px.back().y());
}

TEST(SimulatedCamera, UpsideDownAndSidewaysCamerasSeeTheBoardToo) {
  for (const char* name : {"upside_down", "sideways"}) {
    const Scenario scenario = loadScenario(std::string("cfg/scenarios/") + name + ".yaml");
    const Scene scene(scenario);
    const Trajectory trajectory(scenario);
    int complete = 0;
    for (int k = 0; k < imageCount(scenario); k += 10) {
      complete += trueBoard(scenario, scene, trajectory, k).complete ? 1 : 0;
    }
    EXPECT_GT(complete, 80) << name;
    EXPECT_NEAR(scenario.camera.T_imu_camera().t.norm(), 0.5, 0.01);
    EXPECT_NEAR(scenario.lidar.T_imu_lidar().t.norm(), 0.5, 0.01);
  }
}

TEST(SimulatedCamera, StampsCarryTheClockOffset) {
  Scenario scenario;
  scenario.camera.time_offset_s = 0.02;
  EXPECT_EQ(imageStamp(scenario, 50), scenario.epoch + 1000000000 - 20000000);
}

TEST(SimulatedCamera, TracksAreLandmarksPlusNoise) {
  const Scenario scenario;
  const Scene scene(scenario);
  const Trajectory trajectory(scenario);
  TrackSimulator simulator(scenario, scene, trajectory, 120);
  const CameraModel camera = scenario.camera.cameraModel();
  std::map<std::uint32_t, int> length;
  double squares = 0.0;
  int count = 0;
  for (int k = 0; k < 500; k += 2) {
    const Pose T_C_W = (trajectory.T_W_I(imageTime(scenario, k)) * scenario.camera.T_imu_camera()).inverse();
    const std::vector<TrackObservation> observations = simulator.observe(k);
    EXPECT_GT(observations.size(), 100U);
    for (const TrackObservation& observation : observations) {
      const std::optional<Eigen::Vector2d> px = camera.project(T_C_W * simulator.landmark(observation.id));
      ASSERT_TRUE(px.has_value());
      squares += (observation.px.cast<double>() - *px).squaredNorm();
      ++length[observation.id];
      ++count;
    }
  }
  EXPECT_NEAR(std::sqrt(squares / (2.0 * count)), scenario.camera.track_noise_px, 0.02);
  double mean = 0.0;
  for (const auto& [id, observations] : length) mean += observations;
  EXPECT_GT(mean / static_cast<double>(length.size()), 10.0);
}

}  // namespace
}  // namespace cocalib::sim
