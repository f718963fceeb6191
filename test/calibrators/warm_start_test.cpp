#include <gtest/gtest.h>

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/random.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

/// A drive of some seconds: sweeps and board corners to a fuser that starts from about the truth.
CalibrationEstimate drive(std::uint64_t seed, const std::optional<CalibrationPrior>& prior) {
  sim::Scenario s;
  s.seed = seed;
  s.duration_s = 8.0;
  const sim::Scene scene(s);
  const sim::Trajectory trajectory(s);
  FuserInputs inputs;
  inputs.camera = s.camera.cameraModel();
  inputs.board = s.board.geometry();
  inputs.lidar = true;
  FuserParams params;
  params.prior = prior;
  CoCalibrationFuser fuser(params, {s.imu.gyro_noise_density, 1e-6, s.imu.accel_noise_density, 1e-5}, inputs);
  for (const ImuSample& sample : sim::simulateImu(s, trajectory)) fuser.addImu(sample);
  CalibrationEstimate start;
  start.camera.valid = start.lidar.valid = true;
  start.calibration.T_imu_camera = s.camera.T_imu_camera().plus(Vector6d::Constant(0.004));
  start.calibration.T_imu_lidar = s.lidar.T_imu_lidar().plus(Vector6d::Constant(-0.004));
  fuser.setVisualEstimate(start);
  fuser.setLidarEstimate(start);
  sim::Random random(seed, sim::Random::Stream::kTexture, 9);
  const auto about = [&](TimeNs stamp) {
    NavState state = trajectory.stateAt(stamp);
    Vector6d error;
    error << 0.01 * random.normal3(), 0.003 * random.normal3();
    state.T_W_I = state.T_W_I.plus(error);
    return state;
  };
  for (int k = 1; k < sim::scanCount(s) - 1; ++k) {
    for (int picture = 5 * k; picture < 5 * (k + 1) && picture < sim::imageCount(s); picture += 2) {
      VisualKeyframe visual;
      visual.stamp = sim::imageStamp(s, picture);
      visual.board = sim::simulateBoard(s, scene, trajectory, picture);
      visual.state = about(visual.stamp);
      fuser.addVisual(std::move(visual));
    }
    LidarKeyframe lidar;
    lidar.scan = sim::simulateScan(s, scene, trajectory, k).scan;
    lidar.state = about(lidar.scan.stamp);
    fuser.addLidar(std::move(lidar));
  }
  fuser.finish();
  return fuser.estimate();
}

TEST(WarmStart, ShortDrivesAddUp) {
  const CalibrationEstimate first = drive(1, std::nullopt), alone = drive(2, std::nullopt);
  ASSERT_TRUE(first.camera.valid && alone.camera.valid);
  const CalibrationEstimate both = drive(2, priorFrom(first));
  // Two independent drives: their information adds up.
  const Matrix14d sum = (first.covariance.inverse() + alone.covariance.inverse()).inverse();
  for (int i = 0; i < 14; ++i) {
    EXPECT_NEAR(std::sqrt(both.covariance(i, i) / sum(i, i)), 1.0, 0.1) << i;
    EXPECT_LT(both.covariance(i, i), first.covariance(i, i)) << i;
  }
  const sim::Scenario s;
  const Vector6d lidar_error = both.calibration.T_imu_lidar.minus(s.lidar.T_imu_lidar());
  EXPECT_LT(lidar_error.head<3>().norm(), 3e-3);
  EXPECT_LT(lidar_error.tail<3>().norm(), 1e-3);
}

TEST(WarmStart, WhatTheEarlierRunDidNotKnowStaysUnknown) {
  CalibrationEstimate earlier;
  earlier.lidar.valid = true;
  earlier.calibration.T_imu_lidar.t = {0.1, 0.2, 0.3};
  earlier.covariance.block<6, 6>(6, 6) = 1e-6 * Matrix6d::Identity();
  earlier.covariance(13, 13) = 1e-8;
  const CalibrationPrior prior = priorFrom(earlier);
  EXPECT_EQ(prior.mean.T_imu_lidar.t, Eigen::Vector3d(0.1, 0.2, 0.3));
  EXPECT_EQ(prior.covariance(6, 6), 1e-6);
  EXPECT_EQ(prior.covariance(13, 13), 1e-8);
  EXPECT_EQ(prior.covariance(0, 0), 1.0);  // a metre
  EXPECT_GT(prior.covariance.ldlt().vectorD().minCoeff(), 0.0);
}

}  // namespace
}  // namespace cocalib
