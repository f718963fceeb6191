#include "cocalib/monitor/coverage.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>

namespace cocalib {
namespace {

TEST(MotionCoverage, AddsUpTurningBackAndForth) {
  MotionCoverage coverage;
  for (int i = 0; i <= 400; ++i) {
    ImuSample sample;
    sample.stamp = i * 5'000'000LL;
    sample.gyro = {i < 200 ? 1.0 : -1.0, 0.0, 0.5};
    sample.accel = {i % 2 == 0 ? 1.0 : -1.0, 0.0, 9.81};
    coverage.add(sample);
  }
  EXPECT_NEAR(coverage.duration_s(), 2.0, 1e-9);
  EXPECT_NEAR(coverage.turned_rad().x(), 2.0, 0.01 + 1e-9);  // a sample of 5 ms came back within its tenth of a second
  EXPECT_NEAR(coverage.turned_rad().z(), 1.0, 1e-9);
  EXPECT_NEAR(coverage.rms_rad_s().x(), 1.0, 1e-9);
  EXPECT_NEAR(coverage.rms_rad_s().y(), 0.0, 1e-12);
  EXPECT_NEAR(coverage.shaken_m_s2().x(), 1.0, 1e-9);
  EXPECT_NEAR(coverage.shaken_m_s2().z(), 0.0, 1e-5);  // gravity is no shaking
}

TEST(MotionCoverage, TakesNoiseForNoTurning) {
  // A minute at rest: white noise of 0.01 deg/s/sqrt(Hz) is 0.032 deg/s over a tenth of a second, 1.5 deg a minute;
  // over single samples it would be 10 deg.
  std::mt19937 generator(3);
  std::normal_distribution<double> noise(0.0, 1.745e-4 * std::sqrt(400.0));
  MotionCoverage coverage;
  for (int i = 0; i < 60 * 400; ++i) {
    ImuSample sample;
    sample.stamp = i * 2'500'000LL;
    sample.gyro = {noise(generator), noise(generator), noise(generator)};
    coverage.add(sample);
  }
  EXPECT_LT(coverage.turned_rad().maxCoeff(), 2.0 * M_PI / 180.0);
}

TEST(MotionCoverage, CountsNoGapAndNoRepetition) {
  MotionCoverage coverage;
  for (const TimeNs stamp : {0LL, 10'000'000LL, 10'000'000LL, 5'000'000'000LL, 5'010'000'000LL}) {
    ImuSample sample;
    sample.stamp = stamp;
    sample.gyro.x() = 1.0;
    coverage.add(sample);
  }
  EXPECT_NEAR(coverage.duration_s(), 0.02, 1e-12);
  EXPECT_NEAR(coverage.turned_rad().x(), 0.02, 1e-12);
}

TEST(BoardCoverage, CountsCornersByCell) {
  BoardCoverage coverage;
  coverage.setPictureSize(1600, 1000);
  VisualKeyframe without, with;
  with.board = BoardObservation{{{50.0F, 50.0F}, {1599.5F, 999.5F}, {-3.0F, 50.0F}}};
  coverage.add(without);
  coverage.add(with);
  EXPECT_EQ(coverage.pictures(), 2);
  EXPECT_EQ(coverage.views(), 1);
  EXPECT_EQ(coverage.corners()[0][0], 2);
  EXPECT_EQ(coverage.corners()[9][15], 1);
  EXPECT_NEAR(coverage.coveredShare(), 2.0 / 160.0, 1e-12);
}

}  // namespace
}  // namespace cocalib
