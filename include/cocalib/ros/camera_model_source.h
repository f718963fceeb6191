#pragma once

#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <ros/wall_timer.h>
#include <sensor_msgs/CameraInfo.h>

#include <functional>
#include <mutex>
#include <optional>
#include <string>

#include "cocalib/io/rig_config.h"

namespace cocalib {

/// Brings the camera model of a rig, once: at once where the rig has no camera or names the model itself, else with the
/// first camera_info that can be used. What it waits for, and why a camera_info is refused, goes to the log, again and
/// again while it lasts. Callbacks come from the node handle's queue.
class CameraModelSource {
 public:
  using Callback = std::function<void(const std::optional<CameraModel>&)>;

  /// @param on_model  may be called from within the constructor
  CameraModelSource(ros::NodeHandle nh, const RigConfig& rig, Callback on_model);

  /// What is missing and what to do about it, in words; empty once the model was there. From any thread.
  std::string missing() const;

 private:
  void onInfo(const sensor_msgs::CameraInfo& msg);
  void complain(const std::string& words);

  std::string topic_;
  Callback on_model_;
  mutable std::mutex mutex_;  // guards missing_ and subscriber_
  std::string missing_;
  ros::Subscriber subscriber_;
  ros::WallTimer reminder_;
};

/// Whether pictures on `topic` are CompressedImage: the master knows its type, or its name ends as compressed ones do.
bool isCompressedTopic(const std::string& topic);

}  // namespace cocalib
