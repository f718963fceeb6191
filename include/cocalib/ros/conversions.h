#pragma once

#include <geometry_msgs/Point.h>
#include <geometry_msgs/Pose.h>
#include <geometry_msgs/Transform.h>
#include <geometry_msgs/Vector3.h>
#include <ros/time.h>

#include "cocalib/geometry/pose.h"
#include "cocalib/geometry/time.h"

namespace cocalib {

/// ROS stamp -> nanoseconds, exact.
TimeNs toTimeNs(const ros::Time& time);

/// Nanoseconds -> ROS stamp, exact; what a ros::Time cannot hold (before 1970, after 2106) is clamped.
ros::Time toRosTime(TimeNs stamp);

geometry_msgs::Vector3 toVectorMsg(const Eigen::Vector3d& v);
geometry_msgs::Point toPointMsg(const Eigen::Vector3d& p);
Eigen::Vector3d fromVectorMsg(const geometry_msgs::Vector3& msg);

/// T_A_B as the message whose header says A and whose child says B.
geometry_msgs::Pose toPoseMsg(const Pose& T_A_B);
geometry_msgs::Transform toTransformMsg(const Pose& T_A_B);

/// The quaternion is normalised; one without length counts as no rotation.
Pose fromPoseMsg(const geometry_msgs::Pose& msg);

}  // namespace cocalib
