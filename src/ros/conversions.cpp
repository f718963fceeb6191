#include "cocalib/ros/conversions.h"

#include <algorithm>
#include <cstdint>
#include <limits>

namespace cocalib {
namespace {

constexpr TimeNs kNsPerSecond = 1'000'000'000;
constexpr TimeNs kLatestRosTime = kNsPerSecond * std::numeric_limits<std::uint32_t>::max() + kNsPerSecond - 1;

}  // namespace

TimeNs toTimeNs(const ros::Time& time) {
  return static_cast<TimeNs>(time.sec) * kNsPerSecond + static_cast<TimeNs>(time.nsec);
}

ros::Time toRosTime(TimeNs stamp) {
  const TimeNs held = std::clamp<TimeNs>(stamp, 0, kLatestRosTime);
  return {static_cast<std::uint32_t>(held / kNsPerSecond), static_cast<std::uint32_t>(held % kNsPerSecond)};
}

geometry_msgs::Vector3 toVectorMsg(const Eigen::Vector3d& v) {
  geometry_msgs::Vector3 msg;
  msg.x = v.x();
  msg.y = v.y();
  msg.z = v.z();
  return msg;
}

geometry_msgs::Point toPointMsg(const Eigen::Vector3d& p) {
  geometry_msgs::Point msg;
  msg.x = p.x();
  msg.y = p.y();
  msg.z = p.z();
  return msg;
}

Eigen::Vector3d fromVectorMsg(const geometry_msgs::Vector3& msg) { return {msg.x, msg.y, msg.z}; }

geometry_msgs::Pose toPoseMsg(const Pose& T_A_B) {
  geometry_msgs::Pose msg;
  msg.position.x = T_A_B.t.x();
  msg.position.y = T_A_B.t.y();
  msg.position.z = T_A_B.t.z();
  msg.orientation.x = T_A_B.q.x();
  msg.orientation.y = T_A_B.q.y();
  msg.orientation.z = T_A_B.q.z();
  msg.orientation.w = T_A_B.q.w();
  return msg;
}

geometry_msgs::Transform toTransformMsg(const Pose& T_A_B) {
  geometry_msgs::Transform msg;
  msg.translation = toVectorMsg(T_A_B.t);
  msg.rotation = toPoseMsg(T_A_B).orientation;
  return msg;
}

Pose fromPoseMsg(const geometry_msgs::Pose& msg) {
  Pose T_A_B;
  T_A_B.t = {msg.position.x, msg.position.y, msg.position.z};
  const Eigen::Quaterniond q(msg.orientation.w, msg.orientation.x, msg.orientation.y, msg.orientation.z);
  const double length = q.norm();
  // Leave a unit quaternion bit for bit as it is, so that a round trip changes nothing.
  if (std::abs(length - 1.0) < 1e-12)
    T_A_B.q = q;
  else if (length > 1e-6)
    T_A_B.q = q.normalized();
  return T_A_B;
}

}  // namespace cocalib
