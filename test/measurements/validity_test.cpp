#include "cocalib/measurements/validity.h"

#include <gtest/gtest.h>

#include <functional>

namespace cocalib {
namespace {

/// Of samples at 100 Hz, how many are stuck. @param rate  about z, of the ith one [rad/s]
int countStuck(StuckImu* imu, int samples, const std::function<double(int)>& rate) {
  static TimeNs stamp = toNs(1000.0);
  int stuck = 0;
  for (int i = 0; i < samples; ++i) {
    ImuSample sample;
    sample.stamp = stamp += toNs(0.01);
    sample.gyro.z() = rate(i);
    sample.accel.z() = 9.81;
    stuck += imu->take(sample) ? 1 : 0;
  }
  return stuck;
}

TEST(StuckImu, NumbersThatStandStillWhileItTurnsCannotLast) {
  StuckImu imu;
  const auto turning = [](int i) { return 0.5 + 0.01 * i; };
  EXPECT_EQ(countStuck(&imu, 20, turning), 0);
  EXPECT_EQ(countStuck(&imu, 100, [](int) { return 0.4; }), 94);  // after 0.05 s
  EXPECT_EQ(countStuck(&imu, 20, turning), 0);                    // it goes on
}

TEST(StuckImu, RestWithoutNoiseAndNumbersThatComeTwiceAreRight) {
  StuckImu imu;
  EXPECT_EQ(countStuck(&imu, 100, [](int) { return 0.0; }), 0);
  EXPECT_EQ(countStuck(&imu, 100, [](int i) { return 0.5 + 0.01 * (i / 4); }), 0);
}

}  // namespace
}  // namespace cocalib
