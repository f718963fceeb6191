#include "cocalib/ros/imu_stream.h"

#include <gtest/gtest.h>

#include <functional>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

struct ImuStreamTest : testing::Test {
  /// Feeds samples at 100 Hz. @param rate  about z, of the ith one [rad/s]. @return how many were taken
  int take(int samples, const std::function<double(int)>& rate) {
    int taken = 0;
    for (int i = 0; i < samples; ++i) {
      sensor_msgs::Imu msg;
      stamp += toNs(0.01);
      msg.header.stamp = toRosTime(stamp);
      msg.angular_velocity.z = rate(i);
      msg.linear_acceleration.z = 9.81;
      if (stream.take(msg, &notices).sample) ++taken;
    }
    return taken;
  }

  TimeNs stamp = toNs(1000.0);
  ImuStream stream;
  Notices notices;
};

TEST_F(ImuStreamTest, NumbersThatStandStillWhileItTurnsAreDroppedAndSaid) {
  const auto turning = [](int i) { return 0.5 + 0.01 * i; };
  EXPECT_EQ(take(20, turning), 20);
  EXPECT_EQ(take(100, [](int) { return 0.4; }), 6);  // 0.05 s
  EXPECT_EQ(notices.counted("imu samples stuck"), 94U);
  const std::vector<Notice> said = notices.take();
  ASSERT_EQ(said.size(), 1U);
  EXPECT_NE(said.front().text.find("is stuck"), std::string::npos);
  EXPECT_EQ(take(20, turning), 20);  // it goes on
}

}  // namespace
}  // namespace cocalib
