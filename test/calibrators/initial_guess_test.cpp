#include <gtest/gtest.h>

#include <cmath>
#include <optional>

#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/geometry/so3.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

CalibrationEstimate estimateOf(const sim::Scenario& s, const std::optional<Pose>& guess) {
  const sim::Scene scene(s);
  const sim::Trajectory trajectory(s);
  const ImuNoise noise = {s.imu.gyro_noise_density, 1e-6, s.imu.accel_noise_density, 1e-5};
  LidarInertialCalibrator calibrator(LidarInertialParams(), noise, guess);
  for (const ImuSample& sample : sim::simulateImu(s, trajectory)) calibrator.addImu(sample);
  for (int k = 0; k < sim::scanCount(s); ++k) calibrator.addScan(sim::simulateScan(s, scene, trajectory, k).scan);
  calibrator.flush();
  return calibrator.estimate();
}

/// The true mounting, shifted and turned (about an axis of the IMU).
Pose wrong(const Pose& truth, const Eigen::Vector3d& shift_m, const Eigen::Vector3d& turn_rad) {
  return {(expSo3(turn_rad) * truth.q).normalized(), truth.t + shift_m};
}

/// Turning about one axis only, for a little longer than the calibrator waits before it turns to the guess (9.6 s).
sim::Scenario planar() {
  sim::Scenario s;
  s.motion = sim::Motion::kPlanar;
  s.duration_s = 12.0;
  return s;
}

TEST(InitialGuess, StandsInForWhatAPlanarMotionLeavesOpen) {
  sim::Scenario s = planar();
  s.lidar.time_offset_s = -0.04;  // no guess of it: it comes from the motion
  const Pose truth = s.lidar.T_imu_lidar();
  const CalibrationEstimate estimate = estimateOf(s, wrong(truth, {0.0, 0.0, 0.02}, {0.0, 0.0, 0.0175}));
  ASSERT_TRUE(estimate.lidar.valid) << estimate.message;
  EXPECT_EQ(estimate.status, Status::kUnobservable);
  ASSERT_EQ(estimate.lidar.unobservable.size(), 1U);
  EXPECT_EQ(estimate.lidar.unobservable.front().rfind("translation along imu z", 0), 0U);
  const Vector6d error = estimate.calibration.T_imu_lidar.minus(truth);
  EXPECT_LT(std::abs(error.z()), 3.0 * estimate.lidar.sigma[2]);
  EXPECT_LT(estimate.lidar.sigma[2], 0.11);  // that of a guess
  // All else is shown by the motion, as precisely as by a full one.
  EXPECT_LT(error.head<2>().norm(), 5e-3);
  EXPECT_LT(error.tail<3>().norm(), 1.7e-3);
  EXPECT_NEAR(estimate.calibration.lidar_time_offset_s, -0.04, 5e-4);
}

TEST(InitialGuess, IsLeftAsideWhereItContradictsTheMotion) {
  const sim::Scenario s = planar();
  const Pose truth = s.lidar.T_imu_lidar();
  const CalibrationEstimate estimate = estimateOf(s, wrong(truth, {0.0, 0.0, 0.4}, {0.0, 0.0, 1.5}));
  ASSERT_TRUE(estimate.lidar.valid) << estimate.message;
  EXPECT_EQ(estimate.status, Status::kUnobservable);
  const Vector6d error = estimate.calibration.T_imu_lidar.minus(truth);
  EXPECT_LT(error.tail<3>().norm(), 3e-3);
  EXPECT_GT(estimate.lidar.sigma[2], 0.5);  // not a guess's 0.1 m
  EXPECT_LT(std::abs(error.z()), estimate.lidar.sigma[2]);
}

TEST(InitialGuess, IsAllThereIsWhereTheRigStandsStill) {
  sim::Scenario s = planar();
  s.motion = sim::Motion::kStatic;
  const Pose guess = wrong(s.lidar.T_imu_lidar(), {0.02, 0.0, 0.02}, {0.0, 0.0, 0.0175});
  const CalibrationEstimate estimate = estimateOf(s, guess);
  EXPECT_EQ(estimate.status, Status::kUnobservable);
  EXPECT_EQ(estimate.lidar.unobservable.size(), 6U);
  EXPECT_EQ(estimate.calibration.T_imu_lidar.minus(guess).norm(), 0.0);
  EXPECT_NEAR(estimate.lidar.sigma[0], 0.1, 1e-9);
  EXPECT_NEAR(estimate.lidar.sigma[5], 0.2, 1e-9);
}

TEST(InitialGuess, ThatIsWrongDoesNotTouchAFullMotion) {
  sim::Scenario s;
  s.duration_s = 6.0;
  const Pose truth = s.lidar.T_imu_lidar();
  const CalibrationEstimate without = estimateOf(s, std::nullopt);
  const CalibrationEstimate with = estimateOf(s, wrong(truth, {0.06, -0.06, 0.06}, {0.1, 0.1, -0.1}));
  ASSERT_TRUE(without.lidar.valid && with.lidar.valid) << with.message;
  EXPECT_EQ(with.calibration.T_imu_lidar.minus(without.calibration.T_imu_lidar).norm(), 0.0);
  EXPECT_LT(with.calibration.T_imu_lidar.minus(truth).head<3>().norm(), 5e-3);
}

}  // namespace
}  // namespace cocalib
