#include "cocalib/measurements/thinning.h"

#include <gtest/gtest.h>

#include <array>

namespace cocalib {
namespace {

LidarScan sweepOf16Lasers(int columns) {
  LidarScan scan;
  for (int i = 0; i < 16 * columns; ++i) {
    LidarPoint point;
    point.ring = static_cast<std::int16_t>(i % 16);
    point.offset_s = 1e-6F * static_cast<float>(i);
    scan.points.push_back(point);
  }
  return scan;
}

TEST(Thinning, KeepsTheShareOfEveryLaserInOrder) {
  for (const double share : {0.9, 0.5, 0.25, 0.15}) {
    SCOPED_TRACE(share);
    LidarScan scan = sweepOf16Lasers(1000);
    thin(&scan, share);
    EXPECT_NEAR(static_cast<double>(scan.points.size()), 16'000.0 * share, 20.0);
    std::array<int, 16> of_laser{};
    for (std::size_t i = 0; i < scan.points.size(); ++i) {
      ++of_laser[static_cast<std::size_t>(scan.points[i].ring)];
      if (i > 0) {
        ASSERT_GT(scan.points[i].offset_s, scan.points[i - 1].offset_s);
      }
    }
    for (const int count : of_laser) EXPECT_NEAR(count, 1000.0 * share, 20.0);
  }
}

TEST(Thinning, LeavesAllAndNothing) {
  LidarScan scan = sweepOf16Lasers(10);
  thin(&scan, 1.0);
  EXPECT_EQ(scan.points.size(), 160U);
  thin(&scan, 0.0);
  EXPECT_TRUE(scan.points.empty());
  thin(&scan, 0.5);
  EXPECT_TRUE(scan.points.empty());
}

}  // namespace
}  // namespace cocalib
