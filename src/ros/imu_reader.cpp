#include "cocalib/ros/imu_reader.h"

#include "cocalib/ros/conversions.h"

namespace cocalib {

std::optional<ImuSample> readImu(const sensor_msgs::Imu& msg, std::string* problem) {
  const auto refuse = [problem](const char* why) {
    if (problem != nullptr) *problem = why;
    return std::nullopt;
  };
  if (msg.header.stamp.isZero()) return refuse("IMU message has no stamp");
  if (msg.angular_velocity_covariance[0] == -1.0) return refuse("IMU message says that it carries no angular velocity");
  if (msg.linear_acceleration_covariance[0] == -1.0) return refuse("IMU message says that it carries no acceleration");
  ImuSample sample;
  sample.stamp = toTimeNs(msg.header.stamp);
  sample.gyro = fromVectorMsg(msg.angular_velocity);
  sample.accel = fromVectorMsg(msg.linear_acceleration);
  if (!sample.gyro.allFinite() || !sample.accel.allFinite())
    return refuse("IMU message carries numbers that are not finite");
  return sample;
}

}  // namespace cocalib
