#include "cocalib/sim/lidar.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

namespace cocalib::sim {
namespace {

constexpr LidarModel kModels[] = {LidarModel::kVlp16, LidarModel::kOs1_32, LidarModel::kOs1_64, LidarModel::kOs1_128,
                                  LidarModel::kXt32,  LidarModel::kRs32,   LidarModel::kLivox};

// Points are float: at 10 m one coordinate is rounded by up to 4.8e-7 m, hence the distance by under 1e-6 m.
TEST(SimulatedLidar, NoiseFreePointsLieOnTheirPlanes) {
  for (const LidarModel model : kModels) {
    Scenario scenario;
    scenario.lidar.model = model;
    scenario.lidar.range_noise_m = 0.0;
    scenario.lidar.time_offset_s = -0.015;
    const Scene scene(scenario);
    const Trajectory trajectory(scenario);
    for (const int k : {0, 37}) {
      const SimulatedScan simulated = simulateScan(scenario, scene, trajectory, k);
      ASSERT_GT(simulated.scan.points.size(), sweepBeams(scenario, k).size() * 9 / 10);
      const double begin = trajectory.timeOf(simulated.scan.stamp) + scenario.lidar.time_offset_s;
      const Pose T_I_L = scenario.lidar.T_imu_lidar();
      double worst = 0.0;
      const std::vector<Beam> beams = sweepBeams(scenario, k);
      for (std::size_t i = 0, beam = 0; i < simulated.scan.points.size(); ++i, ++beam) {
        const LidarPoint& point = simulated.scan.points[i];
        while (static_cast<float>(beams[beam].offset_s) != point.offset_s || beams[beam].ring != point.ring) ++beam;
        const Pose T_W_L = trajectory.T_W_I(begin + beams[beam].offset_s) * T_I_L;
        const Plane plane = scene.rectangles()[simulated.surface[i]].plane();
        worst = std::max(worst, std::abs(plane.distance(T_W_L * point.p.cast<double>())));
      }
      EXPECT_LT(worst, 1e-6) << static_cast<int>(model);
    }
  }
}

TEST(SimulatedLidar, FiresAsAVlp16Does) {
  const std::vector<Beam> beams = sweepBeams(Scenario(), 0);
  ASSERT_EQ(beams.size(), 28800U);
  EXPECT_NEAR(beams[1].offset_s, 2.304e-6, 1e-12);
  EXPECT_NEAR(beams[16].offset_s, 0.1 / 1800, 1e-12);
  EXPECT_LT(beams.back().offset_s, 0.1);
  std::set<int> rings;
  for (int i = 0; i < 16; ++i) {
    rings.insert(beams[i].ring);
    EXPECT_NEAR(std::asin(beams[i].direction.z()) * 180 / M_PI, -15.0 + 2.0 * beams[i].ring, 1e-9);
  }
  EXPECT_EQ(rings.size(), 16U);
  for (std::size_t i = 1; i < beams.size(); ++i) ASSERT_GT(beams[i].offset_s, beams[i - 1].offset_s);
}

TEST(SimulatedLidar, RangeNoiseHasTheStatedSize) {
  Scenario scenario;
  const Trajectory trajectory(scenario);
  const Scene scene(scenario);
  const SimulatedScan noisy = simulateScan(scenario, scene, trajectory, 20);
  scenario.lidar.range_noise_m = 0.0;
  const SimulatedScan clean = simulateScan(scenario, scene, trajectory, 20);
  ASSERT_EQ(noisy.scan.points.size(), clean.scan.points.size());
  double squares = 0.0;
  for (std::size_t i = 0; i < clean.scan.points.size(); ++i) {
    const double error = noisy.scan.points[i].p.norm() - clean.scan.points[i].p.norm();
    squares += error * error;
  }
  EXPECT_NEAR(std::sqrt(squares / clean.scan.points.size()), 0.03, 0.03 * 5 / std::sqrt(2.0 * 28000));
}

TEST(SimulatedLidar, SeesTheBoardAndNamesItsPoints) {
  const Scenario scenario;
  const Scene scene(scenario);
  const SimulatedScan simulated = simulateScan(scenario, scene, Trajectory(scenario), 0);
  int on_board = 0;
  for (const std::int16_t surface : simulated.surface) on_board += surface == scene.boardIndex() ? 1 : 0;
  EXPECT_GT(on_board, 300);  // 1 x 0.8 m at 3 m: about 19 deg by 15 deg, 90 columns by 6 or 7 rings
}

TEST(SimulatedLidar, KeepsBeamsWithoutReturnOnRequest) {
  Scenario scenario;
  scenario.lidar.keep_no_return = true;
  scenario.lidar.max_range_m = 4.0;
  const SimulatedScan simulated = simulateScan(scenario, Scene(scenario), Trajectory(scenario), 3);
  ASSERT_EQ(simulated.scan.points.size(), 28800U);
  int missing = 0;
  for (std::size_t i = 0; i < simulated.surface.size(); ++i) {
    EXPECT_EQ(simulated.surface[i] < 0, std::isnan(simulated.scan.points[i].p.x()));
    missing += simulated.surface[i] < 0 ? 1 : 0;
  }
  EXPECT_GT(missing, 1000);
}

}  // namespace
}  // namespace cocalib::sim
