#include "cocalib/estimation/estimate.h"

#include <gtest/gtest.h>

#include <random>
#include <string>

namespace cocalib {
namespace {

// Far from identity, so that a swapped frame cannot cancel out.
Calibration someCalibration() {
  Calibration calibration;
  calibration.T_imu_camera = {expSo3({0.4, -1.1, 2.3}), {0.3, -0.2, 0.5}};
  calibration.T_imu_lidar = {expSo3({-1.7, 0.2, 0.9}), {0.1, 0.3, -0.25}};
  return calibration;
}

TEST(Estimate, LidarCameraCovarianceIsThatOfNumericPropagation) {
  const Calibration calibration = someCalibration();
  Eigen::Matrix<double, 6, 12> J;
  const double step = 1e-6;
  for (int i = 0; i < 12; ++i) {
    const auto moved = [&](double delta) {
      Calibration other = calibration;
      Pose& pose = i < 6 ? other.T_imu_camera : other.T_imu_lidar;
      pose = pose.plus(delta * Vector6d::Unit(i % 6));
      return other.T_lidar_camera().minus(calibration.T_lidar_camera());
    };
    J.col(i) = (moved(step) - moved(-step)) / (2.0 * step);
  }

  std::mt19937 random(5);
  std::normal_distribution<double> normal;
  Matrix14d A;
  for (int i = 0; i < A.size(); ++i) A.data()[i] = normal(random);
  const Matrix14d covariance = A * A.transpose();
  const Matrix6d expected = J * covariance.topLeftCorner<12, 12>() * J.transpose();
  EXPECT_TRUE(lidarCameraCovariance(calibration, covariance).isApprox(expected, 1e-8));
}

TEST(Estimate, MovingBothSensorsTogetherLeavesLidarToCameraKnown) {
  const Calibration calibration = someCalibration();
  Matrix14d covariance = Matrix14d::Zero();  // the same unknown translation of both: fully correlated
  for (const int row : {0, 6}) {
    for (const int column : {0, 6}) covariance.block<3, 3>(row, column).setIdentity();
  }
  EXPECT_LT(lidarCameraCovariance(calibration, covariance).norm(), 1e-14);
}

TEST(Estimate, StatusWords) {
  EXPECT_EQ(std::string(toString(Status::kInsufficientData)), "insufficient_data");
  EXPECT_EQ(std::string(toString(Status::kUnobservable)), "unobservable");
  EXPECT_EQ(std::string(toString(Status::kConverging)), "converging");
  EXPECT_EQ(std::string(toString(Status::kConverged)), "converged");
}

}  // namespace
}  // namespace cocalib
