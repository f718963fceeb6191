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
    if (!frozen_) remember(estimate);
  }
  publisher_.publish(boost::make_shared<CalibrationEstimateMsg>(toEstimateMsg(estimate, diagnostics, frames_)));
}

void EstimatePublisher::remember(const CalibrationEstimate& estimate) {
  const Calibration& calibration = estimate.calibration;
  if (isSeen(estimate.camera) && isFinite(calibration.T_imu_camera)) T_imu_camera_ = calibration.T_imu_camera;
  if (isSeen(estimate.lidar) && isFinite(calibration.T_imu_lidar)) T_imu_lidar_ = calibration.T_imu_lidar;
}

/// tf complains about a transform that comes twice for one instant.
bool EstimatePublisher::isNewer(TimeNs stamp, TimeNs* last) const {
  if (stamp <= *last) return false;
  *last = stamp;
  return true;
}

std::vector<geometry_msgs::TransformStamped> EstimatePublisher::mountings(TimeNs stamp) const {
  std::vector<geometry_msgs::TransformStamped> transforms;
  const auto add = [&](const std::optional<Pose>& T_imu_sensor, const std::string& frame) {
    if (T_imu_sensor && yielded_.count(frame) == 0) {
      transforms.push_back(stamped(*T_imu_sensor, stamp, frames_.imu, frame));
    }
  };
  add(T_imu_camera_, frames_.camera);
  add(T_imu_lidar_, frames_.lidar);
  return transforms;
}

void EstimatePublisher::broadcastMountings(TimeNs stamp) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (frozen_ || !tf_enabled_) return;
  const std::vector<geometry_msgs::TransformStamped> transforms = mountings(stamp);
  if (!transforms.empty() && isNewer(stamp, &last_mounting_)) broadcaster_.sendTransform(transforms);
}

void EstimatePublisher::freeze(const CalibrationEstimate& estimate) {
  const std::lock_guard<std::mutex> lock(mutex_);
  remember(estimate);
  frozen_ = true;
  const std::vector<geometry_msgs::TransformStamped> transforms = mountings(estimate.stamp);
  if (!transforms.empty()) static_broadcaster_.sendTransform(transforms);
}

void EstimatePublisher::setTfEnabled(bool enabled) {
  const std::lock_guard<std::mutex> lock(mutex_);
  tf_enabled_ = enabled;
}

void EstimatePublisher::yield(const std::string& child_frame) {
  const std::lock_guard<std::mutex> lock(mutex_);
  yielded_.insert(child_frame);
}

void EstimatePublisher::broadcastPose(const NavState& state) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!tf_enabled_ || yielded_.count(frames_.imu) != 0) return;
  if (!isFinite(state.T_W_I) || !isNewer(state.stamp, &last_pose_)) return;
  broadcaster_.sendTransform(stamped(state.T_W_I, state.stamp, frames_.world, frames_.imu));
}

void EstimatePublisher::broadcastStart(const ImuSample& sample) {
  constexpr TimeNs kPeriodNs = 50'000'000;
  const std::lock_guard<std::mutex> lock(mutex_);
  if (!tf_enabled_ || yielded_.count(frames_.imu) != 0) return;
  if (last_pose_ != 0 || sample.stamp - last_start_ < kPeriodNs || sample.accel.norm() < 1.0) return;
  last_start_ = sample.stamp;
  const Pose T_W_I = {Eigen::Quaterniond::FromTwoVectors(sample.accel, Eigen::Vector3d::UnitZ()),
                      Eigen::Vector3d::Zero()};
  broadcaster_.sendTransform(stamped(T_W_I, sample.stamp, frames_.world, frames_.imu));
}

void EstimatePublisher::reset() {
  const std::lock_guard<std::mutex> lock(mutex_);
  T_imu_camera_.reset();
  T_imu_lidar_.reset();
  frozen_ = false;
  last_mounting_ = last_pose_ = last_start_ = 0;
}

}  // namespace cocalib
