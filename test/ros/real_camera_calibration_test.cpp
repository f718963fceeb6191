// Camera against IMU on a real recording, which lies beside the repository and not in it.

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <fstream>

#include "cocalib/io/rig_file.h"
#include "cocalib/ros/bag_calibration.h"
#include "cocalib/ros/bag_input.h"

namespace cocalib {
namespace {

const std::string kBag = "../shared/data/euroc_mh01/euroc_mh01.bag";

/// What the dataset's authors give; other programs end 0.4 deg and 14 mm from it, so it is not the truth itself.
Pose reference() {
  Eigen::Matrix3d R;
  R << 0.0148655429818, -0.999880929698, 0.00414029679422, 0.999557249008, 0.0149672133247, 0.025715529948,
      -0.0257744366974, 0.00375618835797, 0.999660727178;
  return {Eigen::Quaterniond(R).normalized(), {-0.0216401454975, -0.064676986768, 0.00981073058949}};
}

CalibrationEstimate calibrate(double start_s, std::optional<double> duration_s, const std::optional<Pose>& guess = {}) {
  RigConfig rig = loadRigFile("cfg/rigs/euroc.yaml");
  rig.guess_T_imu_camera = guess;
  BagInput input(kBag, rig, start_s, duration_s);
  return BagCalibration(rig, &input, {}).run().estimate;
}

void expectNearReference(const CalibrationEstimate& estimate) {
  const Vector6d error = estimate.calibration.T_imu_camera.minus(reference());
  EXPECT_LT(error.head<3>().norm(), 0.018);
  EXPECT_LT(error.tail<3>().norm(), 0.5 * M_PI / 180.0);
}

class RealCamera : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::ifstream(kBag)) GTEST_SKIP() << "recording euroc_mh01 is not in ../shared/data";
  }
};

/// Squared difference of the camera's mounting and clock offset over the sum of both covariances.
double disagreement(const CalibrationEstimate& a, const CalibrationEstimate& b) {
  Eigen::Matrix<double, 7, 1> difference;
  difference << a.calibration.T_imu_camera.minus(b.calibration.T_imu_camera),
      a.calibration.camera_time_offset_s - b.calibration.camera_time_offset_s;
  const Matrix14d sum = a.covariance + b.covariance;
  Eigen::Matrix<double, 7, 7> covariance;
  covariance << sum.block<6, 6>(0, 0), sum.block<6, 1>(0, 12), sum.block<1, 6>(12, 0), sum(12, 12);
  return difference.dot(covariance.ldlt().solve(difference));
}

TEST_F(RealCamera, BothHalvesFindTheCameraAndAgree) {
  // The IMU begins two seconds before the pictures.
  const CalibrationEstimate first = calibrate(0.0, 9.0), second = calibrate(9.0, {});
  expectNearReference(first);
  expectNearReference(second);
  EXPECT_LT(disagreement(first, second), 14.07);  // 95 % of chi-square with 7 degrees
}

TEST_F(RealCamera, AWrongGuessDoesNoHarm) {
  for (const double sign : {1.0, -1.0}) {
    Vector6d off;
    off << 0.1 * sign * Eigen::Vector3d(0.0, 1.0, 0.0), 10.0 * M_PI / 180.0 * sign * Eigen::Vector3d(1.0, 0.0, 0.0);
    expectNearReference(calibrate(0.0, {}, reference().plus(off)));
  }
}

}  // namespace
}  // namespace cocalib
