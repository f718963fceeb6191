#include "cocalib/estimation/camera_group.h"

#include <gtest/gtest.h>

#include <cmath>

#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/random.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

constexpr double kNearest_m = 0.5, kFarthest_m = 0.8;
constexpr int kPointsAtOnce = 60, kFramesOfAPoint = 8;

/// Three seconds of tracks of points close before the camera, without any noise, and everything at the truth.
struct PerfectTracks {
  PerfectTracks() : camera(scenario.camera.cameraModel()) {
    scenario.duration_s = 3.0;
    scenario.imu.gyro_noise_density = scenario.imu.accel_noise_density = 0.0;
    scenario.imu.gyro_bias = scenario.imu.accel_bias = 0.0;
    const sim::Trajectory trajectory(scenario);
    for (const ImuSample& sample : sim::simulateImu(scenario, trajectory)) imu.push(sample);
    for (double t = 0.02; t < scenario.duration_s - 0.1; t += 0.05) {
      state.nodes.push_back(trajectory.stateAt(trajectory.stampOf(t)));
    }
    state.calibration.T_imu_camera = scenario.camera.T_imu_camera();
    chain.update(state.nodes, imu);
    for (int k = 6; k < sim::imageCount(scenario) - 10; k += 3) {
      VisualKeyframe frame;
      frame.stamp = sim::imageStamp(scenario, k);
      frames.push_back(frame);
      poses.push_back(trajectory.stateAt(frame.stamp).T_W_I * state.calibration.T_imu_camera);
    }
    for (std::size_t first = 0; first + kFramesOfAPoint <= frames.size(); first += kFramesOfAPoint) addPoints(first);
  }

  void addPoints(std::size_t first) {
    for (int i = 0; i < kPointsAtOnce; ++i) {
      const Eigen::Vector2d px(random.uniform(200.0, 550.0), random.uniform(120.0, 360.0));
      const Eigen::Vector3d bearing_C = *camera.unproject(px);
      const double depth_m = random.uniform(kNearest_m, kFarthest_m);
      const Eigen::Vector3d p_W = poses[first + kFramesOfAPoint / 2] * (depth_m / bearing_C.z() * bearing_C);
      ++points;
      for (std::size_t f = first; f < first + kFramesOfAPoint; ++f) {
        const auto seen = camera.project(poses[f].inverse() * p_W);
        if (seen && camera.inImage(*seen)) frames[f].tracks.push_back({points, seen->cast<float>()});
      }
    }
  }

  sim::Scenario scenario;
  CameraModel camera;
  sim::Random random{1, sim::Random::Stream::kTexture, 1};
  ImuBuffer imu;
  WindowState state;
  InertialChain chain{ImuNoise{1.7e-4, 1e-6, 6e-4, 1e-5}};
  std::vector<VisualKeyframe> frames;
  std::vector<Pose> poses;  // T_W_C of each
  std::uint32_t points = 0;
};

TEST(CameraGroup, PerfectTracksPullNowhereAtTheTruth) {
  const PerfectTracks perfect;
  CameraGroup::Params params(perfect.camera);
  CameraGroup group(params);
  for (const VisualKeyframe& frame : perfect.frames) group.addFrame(frame);
  group.relink(perfect.state, perfect.chain);
  ChainSystem system(static_cast<int>(perfect.state.nodes.size()), GlobalLayout::size(0));
  group.accumulate(perfect.state, perfect.chain, -1, &system);
  // What is known of a depth beforehand would show here: all landmarks share the scale, and pull it together.
  for (int i = 0; i < 7; ++i) {
    const int row = GlobalLayout::kCamera + i;
    ASSERT_GT(system.H_global(row, row), 0.0);
    EXPECT_LT(std::abs(system.b_global[row]), 0.1 * std::sqrt(system.H_global(row, row))) << "in sigmas, of row " << i;
  }
}

}  // namespace
}  // namespace cocalib
