#include <gtest/gtest.h>

#include <cmath>

#include "trial.h"

namespace cocalib {
namespace {

// Views from one place show no depth. Features that went anywhere for it kept the last round from taking a single step,
// and with more steps made the standing rig outweigh the motion: 5 sigmas, called converged.
TEST(ParkedRig, StaysAsWellCalibratedAsItWas) {
  for (const std::uint64_t seed : {2U, 4U}) {
    sim::Scenario s;
    s.seed = seed;
    s.duration_s = 27.0;
    s.parked_after_s = 12.0;
    const bench::Trial trial = bench::runTrial(s, bench::TrialOptions());
    const CalibrationEstimate& estimate = trial.joint;
    ASSERT_TRUE(estimate.camera.valid && estimate.lidar.valid) << estimate.message;
    const Calibration &found = estimate.calibration, &truth = trial.truth;
    Vector14d error;
    error << found.T_imu_camera.minus(truth.T_imu_camera), found.T_imu_lidar.minus(truth.T_imu_lidar),
        found.camera_time_offset_s - truth.camera_time_offset_s, found.lidar_time_offset_s - truth.lidar_time_offset_s;
    for (int i = 0; i < 14; ++i) {
      EXPECT_LT(std::abs(error[i]), 3.5 * std::sqrt(estimate.covariance(i, i))) << seed << ", axis " << i;
    }
    const double nees = error.dot(estimate.covariance.ldlt().solve(error));
    EXPECT_LT(nees, 36.1) << seed;  // 99.9 % of chi-square with 14 degrees
  }
}

}  // namespace
}  // namespace cocalib
