#include "cocalib/estimation/repeat_weight.h"

#include <gtest/gtest.h>

namespace cocalib {
namespace {

TEST(RepeatWeight, TheNthFromOnePlaceCountsOneNth) {
  RepeatWeight weight;
  const Pose here{expSo3({0.1, -0.2, 0.3}), {4.0, -1.0, 2.0}};
  for (int n = 1; n <= 4; ++n) EXPECT_DOUBLE_EQ(weight.next(here), 1.0 / n);
}

TEST(RepeatWeight, EveryOneFromAMovingSensorCounts) {
  RepeatWeight shifted, turned;
  for (int n = 0; n < 4; ++n) {
    EXPECT_EQ(shifted.next({Eigen::Quaterniond::Identity(), {0.0, 0.006 * n, 0.0}}), 1.0);
    EXPECT_EQ(turned.next({expSo3({0.0025 * n, 0.0, 0.0}), Eigen::Vector3d::Zero()}), 1.0);
  }
}

// Slow creeping leaves the place in the end: it is that of the first measurement, not of the last.
TEST(RepeatWeight, CreepingLeavesThePlace) {
  RepeatWeight weight;
  int full = 0;
  for (int n = 0; n < 100; ++n) full += weight.next({Eigen::Quaterniond::Identity(), {0.0011 * n, 0.0, 0.0}}) == 1.0;
  EXPECT_EQ(full, 20);
}

}  // namespace
}  // namespace cocalib
