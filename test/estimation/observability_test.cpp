#include "cocalib/estimation/observability.h"

#include <gtest/gtest.h>

namespace cocalib {
namespace {

CalibrationEstimate withSigmas(double translation_m, double rotation_rad, double offset_s) {
  CalibrationEstimate estimate;
  estimate.covariance.setZero();
  for (int i = 0; i < 12; ++i) {
    const double sigma = i % 6 < 3 ? translation_m : rotation_rad;
    estimate.covariance(i, i) = sigma * sigma;
  }
  estimate.covariance(12, 12) = estimate.covariance(13, 13) = offset_s * offset_s;
  return estimate;
}

TEST(Observability, ConvergedWhenEverySigmaIsSmall) {
  CalibrationEstimate estimate = withSigmas(0.001, 0.0003, 0.0001);
  judgeEstimate(true, true, ObservabilityThresholds(), &estimate);
  EXPECT_EQ(estimate.status, Status::kConverged);
  EXPECT_TRUE(estimate.camera.valid && estimate.lidar.valid && estimate.lidar_camera.valid);
  EXPECT_NEAR(estimate.camera.sigma[0], 0.001, 1e-12);
}

TEST(Observability, NamesTheAxisAndTheMissingMotion) {
  CalibrationEstimate estimate = withSigmas(0.001, 0.0003, 0.0001);
  estimate.covariance(8, 8) = 0.25;  // lidar, translation along z
  judgeEstimate(true, true, ObservabilityThresholds(), &estimate);
  EXPECT_EQ(estimate.status, Status::kUnobservable);
  ASSERT_EQ(estimate.lidar.unobservable.size(), 1U);
  EXPECT_EQ(estimate.lidar.unobservable[0], "translation along imu z: rotate about x or y");
  EXPECT_TRUE(estimate.camera.unobservable.empty());
  EXPECT_NE(estimate.message.find("lidar translation along imu z"), std::string::npos) << estimate.message;
}

TEST(Observability, StillConvergingNamesTheWorstAxis) {
  CalibrationEstimate estimate = withSigmas(0.001, 0.0003, 0.0001);
  estimate.covariance(3, 3) = 0.01 * 0.01;  // camera, rotation about x: 0.57 deg
  judgeEstimate(true, false, ObservabilityThresholds(), &estimate);
  EXPECT_EQ(estimate.status, Status::kConverging);
  EXPECT_NE(estimate.message.find("camera rotation about imu x is known to 0.57 deg"), std::string::npos)
      << estimate.message;
  EXPECT_FALSE(estimate.lidar.valid);
}

TEST(Observability, AnUncertainClockIsNotConverged) {
  CalibrationEstimate estimate = withSigmas(0.001, 0.0003, 0.01);
  judgeEstimate(false, true, ObservabilityThresholds(), &estimate);
  EXPECT_EQ(estimate.status, Status::kConverging);
}

}  // namespace
}  // namespace cocalib
