#include "cocalib/monitor/coverage.h"

#include <gtest/gtest.h>

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
  EXPECT_NEAR(coverage.turned_rad().x(), 2.0, 1e-9);
  EXPECT_NEAR(coverage.turned_rad().z(), 1.0, 1e-9);
  EXPECT_NEAR(coverage.rms_rad_s().x(), 1.0, 1e-9);
  EXPECT_NEAR(coverage.rms_rad_s().y(), 0.0, 1e-12);
  EXPECT_NEAR(coverage.shaken_m_s2().x(), 1.0, 1e-9);
  EXPECT_NEAR(coverage.shaken_m_s2().z(), 0.0, 1e-5);  // gravity is no shaking
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
