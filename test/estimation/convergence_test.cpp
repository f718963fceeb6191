#include "cocalib/estimation/convergence.h"

#include <gtest/gtest.h>

#include <cmath>
#include <numeric>
#include <random>

namespace cocalib {
namespace {

std::vector<int> allRows() {
  std::vector<int> rows(14);
  std::iota(rows.begin(), rows.end(), 0);
  return rows;
}

/// An estimate at identity with the given sigmas.
CalibrationEstimate estimateWith(double translation_m, double rotation_rad, double offset_s) {
  CalibrationEstimate e;
  Vector14d sigma;
  sigma << Eigen::Vector3d::Constant(translation_m), Eigen::Vector3d::Constant(rotation_rad),
      Eigen::Vector3d::Constant(translation_m), Eigen::Vector3d::Constant(rotation_rad), offset_s, offset_s;
  e.covariance = sigma.array().square().matrix().asDiagonal();
  return e;
}

TEST(Disagreement, RarelyDoubtsHalvesThatDifferAsTheirCovariancesSay) {
  const CalibrationEstimate all = estimateWith(1e-3, 1e-4, 1e-5);
  CalibrationEstimate half = estimateWith(std::sqrt(2.0) * 1e-3, std::sqrt(2.0) * 1e-4, std::sqrt(2.0) * 1e-5);
  std::mt19937_64 random(5);
  std::normal_distribution<double> normal;
  int doubted = 0;
  constexpr int kTrials = 5000;
  for (int k = 0; k < kTrials; ++k) {
    // The half's error beyond that of the whole has the covariance P_half - P_all, here P_all itself.
    Vector6d d;
    for (int i = 0; i < 6; ++i) d[i] = normal(random) * std::sqrt(all.covariance(i, i));
    half.calibration.T_imu_camera = Pose().plus(d);
    for (int i = 0; i < 6; ++i) d[i] = normal(random) * std::sqrt(all.covariance(6 + i, 6 + i));
    half.calibration.T_imu_lidar = Pose().plus(d);
    half.calibration.camera_time_offset_s = 1e-5 * normal(random);
    half.calibration.lidar_time_offset_s = 1e-5 * normal(random);
    doubted += disagreement(half, all, allRows()).has_value() ? 1 : 0;
  }
  EXPECT_LE(doubted, 2);  // one in ten thousand is meant
}

TEST(Disagreement, NamesTheAxisThatMoved) {
  const CalibrationEstimate all = estimateWith(1e-3, 1e-4, 1e-5);
  CalibrationEstimate half = estimateWith(1.4e-3, 1.4e-4, 1.4e-5);
  half.calibration.T_imu_lidar.t.y() = 0.02;
  const auto what = disagreement(half, all, allRows());
  ASSERT_TRUE(what);
  EXPECT_NE(what->find("lidar translation along imu y by 20.0 mm"), std::string::npos) << *what;
  EXPECT_FALSE(disagreement(half, all, {0, 1, 2, 3, 4, 5, 12}));  // the camera has not moved
  half.calibration = Calibration();
  half.calibration.camera_time_offset_s = 3e-4;
  const auto clock = disagreement(half, all, allRows());
  ASSERT_TRUE(clock);
  EXPECT_NE(clock->find("camera clock offset by 0.30 ms"), std::string::npos) << *clock;
}

TEST(Disagreement, LetsMinutesOfDataDifferByWhatDoesNotMatter) {
  const CalibrationEstimate all = estimateWith(1e-5, 1e-6, 1e-7);
  CalibrationEstimate half = estimateWith(1.4e-5, 1.4e-6, 1.4e-7);
  half.calibration.T_imu_camera.t.x() = 1e-4;
  EXPECT_FALSE(disagreement(half, all, allRows()));
  half.calibration.T_imu_camera.t.x() = 1e-3;
  EXPECT_TRUE(disagreement(half, all, allRows()));
}

TEST(Disagreement, LetsAWeakStartBeAnywhere) {
  const CalibrationEstimate all = estimateWith(1e-3, 1e-4, 1e-5);
  CalibrationEstimate start = estimateWith(0.5, 0.1, 0.05);
  start.calibration.T_imu_camera.t.x() = 0.7;
  EXPECT_FALSE(disagreement(start, all, allRows()));
}

TEST(EstimateHistory, FindsTheHalfHoweverLongTheRun) {
  EstimateHistory history;
  EXPECT_EQ(history.half(), nullptr);
  for (int k = 1; k <= 3000; ++k) {
    CalibrationEstimate e;
    e.duration_s = k;
    history.add(e);
    if (k < 4) continue;
    ASSERT_NE(history.half(), nullptr) << k;
    EXPECT_NEAR(history.half()->duration_s, 0.5 * k, 0.21 * k) << k;
  }
}

}  // namespace
}  // namespace cocalib
