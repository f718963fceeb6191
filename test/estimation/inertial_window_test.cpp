#include "cocalib/estimation/inertial_window.h"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "cocalib/estimation/observability.h"
#include "estimation/simulated_window.h"

namespace cocalib {
namespace {

using test::SimulatedWindow;

sim::Scenario scenario(double duration_s, std::uint64_t seed, sim::Motion motion = sim::Motion::kFull) {
  sim::Scenario out;
  out.duration_s = duration_s;
  out.seed = seed;
  out.motion = motion;
  return out;
}

SimulatedWindow::Use corners() {
  SimulatedWindow::Use use;
  use.corners = true;
  return use;
}
SimulatedWindow::Use tracks() {
  SimulatedWindow::Use use;
  use.tracks = true;
  return use;
}
SimulatedWindow::Use lidar() {
  SimulatedWindow::Use use;
  use.lidar = true;
  return use;
}

/// Normalised error of the camera's (or the lidar's) seven parameters.
double nees(SimulatedWindow* sim, bool camera) {
  Matrix14d P;
  EXPECT_TRUE(sim->window().calibrationCovariance(&P));
  const int pose = camera ? 0 : 6, offset = camera ? 12 : 13;
  const Vector14d e = sim->error();
  Eigen::Matrix<double, 7, 7> C;
  Eigen::Matrix<double, 7, 1> d;
  d << e.segment<6>(pose), e[offset];
  C << P.block<6, 6>(pose, pose), P.block<6, 1>(pose, offset), P.block<1, 6>(offset, pose), P(offset, offset);
  return d.dot(C.ldlt().solve(d));
}

TEST(InertialWindow, FindsTheCameraFromTheBoard) {
  SimulatedWindow sim(scenario(8.0, 1), corners());
  sim.solve();
  // Cramer-Rao bound for 10 s: 0.20 mrad, 0.63 mm; 8 s with corners at 25 Hz are a little worse. Four of those.
  EXPECT_LT(sim.error().head<3>().norm(), 4e-3);
  EXPECT_LT(sim.error().segment<3>(3).norm(), 1.2e-3);
}

TEST(InertialWindow, CameraCovarianceIsHonest) {
  // Mean of 7 chi-square with 7 degrees over 12 seeds: 95 % band 4.99 .. 9.34, widened a little for linearisation.
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= 12; ++seed) {
    SimulatedWindow sim(scenario(5.0, seed), corners());
    sim.solve();
    sum += nees(&sim, true);
  }
  EXPECT_GT(sum / 12.0, 4.5);
  EXPECT_LT(sum / 12.0, 10.0);
}

TEST(InertialWindow, ToldALittleNoiseItMeasuresTheImu) {
  SimulatedWindow::Use use = corners();
  use.assumed_imu_noise = 1.0 / 3.0;
  SimulatedWindow sim(scenario(20.0, 4), use);
  for (int round = 0; round < 8; ++round) {  // each goes a part of the way
    sim.solve();
    sim.window().learnNoise();
  }
  EXPECT_NEAR(sim.window().imuNoiseScale().gyro, 3.0, 0.3);
  EXPECT_LT(nees(&sim, true), 24.3);  // 99.9 % of chi-square with 7 degrees
}

TEST(InertialWindow, ToldTheRightNoiseItKeepsIt) {
  SimulatedWindow sim(scenario(10.0, 4), corners());
  sim.solve();
  sim.window().learnNoise();
  EXPECT_LT(sim.window().imuNoiseScale().gyro, 1.1);
  EXPECT_LT(sim.window().imuNoiseScale().accel, 1.1);
}

TEST(InertialWindow, FindsTheCameraFromTracksAlone) {
  SimulatedWindow sim(scenario(8.0, 2), tracks());
  sim.solve();
  EXPECT_LT(sim.error().head<3>().norm(), 10e-3);
  EXPECT_LT(sim.error().segment<3>(3).norm(), 2e-3);
  EXPECT_LT(nees(&sim, true), 24.3);  // 99.9 % of chi-square with 7 degrees
}

TEST(InertialWindow, FindsTheLidarFromUnknownPlanes) {
  SimulatedWindow sim(scenario(6.0, 3), lidar());
  sim.solve();
  EXPECT_GE(sim.window().state().planes.size(), 6U);
  EXPECT_LT(sim.error().segment<3>(6).norm(), 3e-3);
  EXPECT_LT(sim.error().segment<3>(9).norm(), 1e-3);
  EXPECT_LT(nees(&sim, false), 24.3);
}

/// What a rig finds that has been driven this far from where it started: error and covariance, after a marginalization.
std::pair<Vector14d, Matrix14d> foundAt(const Eigen::Vector3d& place) {
  SimulatedWindow::Use use;
  use.corners = use.tracks = use.lidar = true;
  use.place = place;
  SimulatedWindow sim(scenario(3.0, 3), use);
  sim.solve();
  EXPECT_TRUE(sim.window().marginalizeBefore(sim.trajectory().stampOf(1.5)));
  sim.window().relink(Relink::kNewScans, 0.0);
  sim.window().optimize(8);
  Matrix14d P;
  EXPECT_TRUE(sim.window().calibrationCovariance(&P));
  return {sim.error(), P};
}

TEST(InertialWindow, ADriveOfAHundredKilometersChangesNothing) {
  const Eigen::Vector3d far(80e3, -60e3, 500.0);  // whole voxels, so that the same points share one
  const auto [near_error, near_P] = foundAt(Eigen::Vector3d::Zero());
  const auto [far_error, far_P] = foundAt(far);
  for (int i = 0; i < 14; ++i) {
    const double sigma = std::sqrt(near_P(i, i));
    EXPECT_NEAR(far_error[i], near_error[i], 0.1 * sigma) << i;
    EXPECT_NEAR(std::sqrt(far_P(i, i)), sigma, 0.02 * sigma) << i;
  }
}

TEST(InertialWindow, MarginalizationKeepsWhatWasKnown) {
  SimulatedWindow sim(scenario(6.0, 4), corners());
  sim.solve();
  Matrix14d before, after;
  ASSERT_TRUE(sim.window().calibrationCovariance(&before));
  ASSERT_TRUE(sim.window().marginalizeBefore(sim.trajectory().stampOf(4.0)));
  sim.window().relink(Relink::kNewScans, 0.0);
  ASSERT_TRUE(sim.window().calibrationCovariance(&after));
  for (int i = 0; i < 6; ++i) EXPECT_NEAR(after(i, i), before(i, i), 0.02 * before(i, i));
  const Vector14d e = sim.error();
  sim.window().optimize(5);
  const Vector14d moved = sim.error() - e;
  for (int i = 0; i < 6; ++i) EXPECT_LT(std::abs(moved[i]), 0.2 * std::sqrt(before(i, i)));
}

TEST(InertialWindow, PlanarMotionLeavesTheVerticalLeverArmUnknown) {
  SimulatedWindow sim(scenario(6.0, 5, sim::Motion::kPlanar), corners());
  sim.solve();
  Matrix14d P;
  ASSERT_TRUE(sim.window().calibrationCovariance(&P));
  const SensorVerdict verdict = judge(P.topLeftCorner<6, 6>(), P(12, 12), "imu", ObservabilityThresholds());
  ASSERT_EQ(verdict.unobservable.size(), 1U);
  EXPECT_EQ(verdict.unobservable[0], "translation along imu z: rotate about x or y");
  EXPECT_FALSE(isConverged(verdict, ObservabilityThresholds()));
  EXPECT_LT(std::abs(sim.error()[2]), 3.0 * verdict.sigma[2]);
}

TEST(InertialWindow, FeedbackLeavesOpenDirectionsAlone) {
  sim::Scenario planar = scenario(6.0, 2);
  planar.motion = sim::Motion::kPlanar;
  SimulatedWindow sim(planar, corners());
  sim.solve();
  const Calibration own = sim.window().state().calibration;
  Calibration fed_back = own;
  fed_back.T_imu_camera.t += Eigen::Vector3d(0.01, -0.02, 0.3);
  sim.window().setLinearization(fed_back);
  const Eigen::Vector3d moved = sim.window().state().calibration.T_imu_camera.t - own.T_imu_camera.t;
  EXPECT_NEAR(moved.x(), 0.01, 1e-3);
  EXPECT_NEAR(moved.y(), -0.02, 1e-3);
  EXPECT_NEAR(moved.z(), 0.0, 1e-3);
}

TEST(InertialWindow, RepeatsToTheBit) {
  SimulatedWindow a(scenario(3.0, 6), corners()), b(scenario(3.0, 6), corners());
  a.solve();
  b.solve();
  EXPECT_EQ(a.error(), b.error());
}

}  // namespace
}  // namespace cocalib
