#pragma once

#include <geometry_msgs/TransformStamped.h>
#include <ros/node_handle.h>
#include <ros/publisher.h>
#include <tf2_ros/static_transform_broadcaster.h>
#include <tf2_ros/transform_broadcaster.h>

#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/ros/estimate_conversions.h"

namespace cocalib {

/// Publishes the joint estimate (`estimate`, latched) and what follows from it on tf: imu -> camera and imu -> lidar,
/// stamped anew with the data so that listeners find them at every picture and sweep, and world -> imu. What is not
/// known or not finite is not published. All functions may be called from any thread.
class EstimatePublisher {
 public:
  EstimatePublisher(ros::NodeHandle nh, const FrameNames& frames);

  void publish(const CalibrationEstimate& estimate, const CalibratorDiagnostics& diagnostics);
  /// @param stamp  of the newest data
  void broadcastMountings(TimeNs stamp);
  void broadcastPose(const NavState& state);
  /// Until the first pose is known: the IMU at the origin, upright as its accelerometer says, so that there is a world
  /// to show things in from the first second on.
  void broadcastStart(const ImuSample& sample);
  void setTfEnabled(bool enabled);
  /// Leaves a frame to somebody else who publishes it.
  void yield(const std::string& child_frame);
  /// Publishes the mountings once, as static transforms, in place of the re-stamped ones; until reset().
  void freeze(const CalibrationEstimate& estimate);
  /// Forgets the estimate: the clock was set back or a new calibration begins.
  void reset();

 private:
  bool isNewer(TimeNs stamp, TimeNs* last) const;
  void remember(const CalibrationEstimate& estimate);
  std::vector<geometry_msgs::TransformStamped> mountings(TimeNs stamp) const;

  FrameNames frames_;
  ros::Publisher publisher_;
  tf2_ros::TransformBroadcaster broadcaster_;
  tf2_ros::StaticTransformBroadcaster static_broadcaster_;
  std::mutex mutex_;  // guards what follows
  std::optional<Pose> T_imu_camera_, T_imu_lidar_;
  TimeNs last_mounting_ = 0, last_pose_ = 0, last_start_ = 0;
  bool frozen_ = false, tf_enabled_ = true;
  std::set<std::string> yielded_;
};

}  // namespace cocalib
