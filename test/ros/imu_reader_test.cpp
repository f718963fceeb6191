#include "cocalib/ros/imu_reader.h"

#include <gtest/gtest.h>

#include <limits>

namespace cocalib {
namespace {

sensor_msgs::Imu makeImu() {
  sensor_msgs::Imu msg;
  msg.header.stamp = ros::Time(1600000000, 123456789);
  msg.orientation_covariance[0] = -1.0;  // no orientation: does not matter
  msg.angular_velocity.x = 0.1;
  msg.angular_velocity.y = -0.2;
  msg.angular_velocity.z = 0.3;
  msg.linear_acceleration.x = 1.0;
  msg.linear_acceleration.y = 2.0;
  msg.linear_acceleration.z = 9.8;
  return msg;
}

TEST(ImuReader, ReadsRateAccelerationAndStamp) {
  std::string problem;
  const std::optional<ImuSample> sample = readImu(makeImu(), &problem);
  ASSERT_TRUE(sample) << problem;
  EXPECT_EQ(sample->stamp, 1600000000123456789);
  EXPECT_EQ(sample->gyro, Eigen::Vector3d(0.1, -0.2, 0.3));
  EXPECT_EQ(sample->accel, Eigen::Vector3d(1.0, 2.0, 9.8));
}

TEST(ImuReader, SaysWhyItRefuses) {
  using Imu = sensor_msgs::Imu;
  const auto says = [](const auto& spoil, const std::string& word) {
    Imu msg = makeImu();
    spoil(&msg);
    std::string problem;
    EXPECT_FALSE(readImu(msg, &problem));
    EXPECT_NE(problem.find(word), std::string::npos) << problem;
    EXPECT_FALSE(readImu(msg, nullptr));
  };
  says([](Imu* m) { m->header.stamp = ros::Time(); }, "no stamp");
  says([](Imu* m) { m->angular_velocity.y = std::numeric_limits<double>::quiet_NaN(); }, "finite");
  says([](Imu* m) { m->linear_acceleration.z = std::numeric_limits<double>::infinity(); }, "finite");
  says([](Imu* m) { m->angular_velocity_covariance[0] = -1.0; }, "no angular velocity");
  says([](Imu* m) { m->linear_acceleration_covariance[0] = -1.0; }, "no acceleration");
}

}  // namespace
}  // namespace cocalib
