#include "cocalib/sim/picture_faults.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/core.hpp>

#include "cocalib/sim/camera.h"

namespace cocalib::sim {
namespace {

cv::Mat flatPicture(const Scenario& scenario, float gray = 100.0F) {
  return {scenario.camera.height, scenario.camera.width, CV_32FC1, cv::Scalar(gray)};
}

double meanAt(const Scenario& scenario, const PictureFaults& faults, double t) {
  cv::Mat image = flatPicture(scenario);
  faults.apply(static_cast<int>(std::lround(t * scenario.camera.rate_hz)), image);
  return cv::mean(image)[0];
}

TEST(PictureFaults, AreAbsentByDefault) {
  const Scenario scenario;
  const PictureFaults faults(scenario);
  for (int k = 0; k < 100; ++k) {
    cv::Mat image = flatPicture(scenario);
    faults.apply(k, image);
    EXPECT_EQ(cv::norm(image, flatPicture(scenario)), 0.0);
    EXPECT_FALSE(faults.isDropped(k));
  }
}

TEST(PictureFaults, BlackoutCoversItsTimeOnly) {
  Scenario scenario;
  scenario.camera.faults.blackout_start_s = 1.0;
  scenario.camera.faults.blackout_s = 0.5;
  const PictureFaults faults(scenario);
  EXPECT_EQ(meanAt(scenario, faults, 0.98), 100.0);
  EXPECT_EQ(meanAt(scenario, faults, 1.0), 0.0);
  EXPECT_EQ(meanAt(scenario, faults, 1.48), 0.0);
  EXPECT_EQ(meanAt(scenario, faults, 1.5), 100.0);
}

TEST(PictureFaults, BrightnessHoldsALevelAndThenSteps) {
  Scenario scenario;
  scenario.camera.faults.brightness_period_s = 1.0;
  scenario.camera.faults.brightness_factor = 2.0;
  const PictureFaults faults(scenario);
  int steps = 0;
  for (int second = 0; second < 10; ++second) {
    const double level = meanAt(scenario, faults, second + 0.1);
    EXPECT_EQ(meanAt(scenario, faults, second + 0.9), level);
    EXPECT_GE(level, 50.0);
    EXPECT_LE(level, 200.0);
    steps += std::abs(meanAt(scenario, faults, second + 1.1) - level) > 5.0;
  }
  EXPECT_GE(steps, 7);
}

TEST(PictureFaults, DropsItsShareOfThePictures) {
  Scenario scenario;
  scenario.camera.faults.dropped = 0.2;
  const PictureFaults faults(scenario);
  int dropped = 0;
  for (int k = 0; k < 5000; ++k) dropped += faults.isDropped(k);
  EXPECT_NEAR(dropped, 1000, 4.0 * std::sqrt(5000 * 0.2 * 0.8));
}

TEST(PictureFaults, MovingObjectCoversItsShareAndMoves) {
  Scenario scenario;
  scenario.camera.faults.moving_object = 0.33;
  const PictureFaults faults(scenario);
  const auto covered = [&](double t) {
    cv::Mat image = flatPicture(scenario, -1.0F);
    faults.apply(static_cast<int>(std::lround(t * scenario.camera.rate_hz)), image);
    return cv::Mat(image >= 0.0F);
  };
  const cv::Mat first = covered(0.0), later = covered(1.0);
  const double pixels = scenario.camera.width * scenario.camera.height;
  EXPECT_NEAR(cv::countNonZero(first) / pixels, 0.33, 0.005);
  EXPECT_GT(cv::countNonZero(later & ~first) / pixels, 0.2);
}

}  // namespace
}  // namespace cocalib::sim
