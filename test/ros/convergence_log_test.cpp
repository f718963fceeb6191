#include "cocalib/ros/convergence_log.h"

#include <gtest/gtest.h>

#include <opencv2/core.hpp>

namespace cocalib {
namespace {

/// Half a minute of estimates of both sensors with numbers of many digits.
ConvergenceLog someLog(Status last) {
  ConvergenceLog log;
  for (int second = 4; second <= 31; ++second) {
    CalibrationEstimate estimate;
    estimate.stamp = toNs(second);
    estimate.duration_s = second;
    estimate.status = second == 31 ? last : Status::kConverging;
    for (SensorVerdict* verdict : {&estimate.camera, &estimate.lidar}) {
      verdict->valid = true;
      verdict->sigma.setConstant(5.6e-5 * 31.0 / second);
      verdict->time_offset_sigma_s = 1.9e-5;
    }
    log.add(estimate);
  }
  return log;
}

TEST(ConvergenceLog, DrawsEverythingWithinTheSmallestPicture) {
  const cv::Mat picture = someLog(Status::kConverged).draw({800, 600});
  ASSERT_EQ(picture.size(), cv::Size(800, 600));
  // A text that is cut, by the picture's border or by the other sensor's half, would have ink there.
  for (const int column : {397, 398, 399, 797, 798, 799}) {
    cv::Mat half = picture.col(column).rowRange(24, 600).clone();
    half = half.reshape(1);
    EXPECT_EQ(cv::countNonZero(half != 255), 0) << column;
  }
}

TEST(ConvergenceLog, SaysTheStatusInItsColour) {
  const auto colour = [](Status status) { return someLog(status).draw({800, 600}).at<cv::Vec3b>(12, 10); };
  const cv::Vec3b converged = colour(Status::kConverged), open = colour(Status::kUnobservable);
  EXPECT_GT(converged[1], converged[2]);  // green
  EXPECT_GT(open[2], open[1]);            // red
}

}  // namespace
}  // namespace cocalib
