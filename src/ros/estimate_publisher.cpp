#include "cocalib/ros/estimate_publisher.h"

#include <geometry_msgs/TransformStamped.h>

#include <boost/make_shared.hpp>
#include <vector>

#include "cocalib/estimation/observability.h"
#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

bool isFinite(const Pose& pose) { return pose.t.allFinite() && pose.q.coeffs().allFinite(); }

geometry_msgs::TransformStamped stamped(const Pose& T_A_B, TimeNs stamp, const std::string& a, const std::string& b) {
  geometry_msgs::TransformStamped msg;
  msg.header.stamp = toRosTime(stamp);
  msg.header.frame_id = a;
  msg.child_frame_id = b;
  msg.transform = toTransformMsg(T_A_B);
  return msg;
}

}  // namespace

EstimatePublisher::EstimatePublisher(ros::NodeHandle nh, const FrameNames& frames)
    : frames_(frames), publisher_(nh.advertise<CalibrationEstimateMsg>("estimate", 10, true)) {}

void EstimatePublisher::publish(const CalibrationEstimate& estimate, const CalibratorDiagnostics& diagnostics) {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    const Calibration& calibration = estimate.calibration;
    if (isSeen(estimate.camera) && isFinite(calibration.T_imu_camera)) T_imu_camera_ = calibration.T_imu_camera;
    if (isSeen(estimate.lidar) && isFinite(calibration.T_imu_lidar)) T_imu_lidar_ = calibration.T_imu_lidar;
  }
  publisher_.publish(boost::make_shared<CalibrationEstimateMsg>(toEstimateMsg(estimate, diagnostics, frames_)));
}

/// tf complains about a transform that comes twice for one instant.
bool EstimatePublisher::isNewer(TimeNs stamp, TimeNs* last) const {
  if (stamp <= *last) return false;
  *last = stamp;
  return true;
}

void EstimatePublisher::broadcastMountings(TimeNs stamp) {
  const std::lock_guard<std::mutex> lock(mutex_);
  std::vector<geometry_msgs::TransformStamped> transforms;
  if (T_imu_camera_) transforms.push_back(stamped(*T_imu_camera_, stamp, frames_.imu, frames_.camera));
  if (T_imu_lidar_) transforms.push_back(stamped(*T_imu_lidar_, stamp, frames_.imu, frames_.lidar));
  if (!transforms.empty() && isNewer(stamp, &last_mounting_)) broadcaster_.sendTransform(transforms);
}

void EstimatePublisher::broadcastPose(const NavState& state) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!isFinite(state.T_W_I) || !isNewer(state.stamp, &last_pose_)) return;
  broadcaster_.sendTransform(stamped(state.T_W_I, state.stamp, frames_.world, frames_.imu));
}

void EstimatePublisher::reset() {
  const std::lock_guard<std::mutex> lock(mutex_);
  T_imu_camera_.reset();
  T_imu_lidar_.reset();
  last_mounting_ = last_pose_ = 0;
}

}  // namespace cocalib
