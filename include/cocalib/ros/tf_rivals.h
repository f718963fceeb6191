#pragma once

#include <ros/message_event.h>
#include <ros/node_handle.h>
#include <ros/subscriber.h>
#include <tf2_msgs/TFMessage.h>

#include <functional>
#include <set>
#include <string>
#include <vector>

#include "cocalib/ros/estimate_conversions.h"

namespace cocalib {

/// Notices when somebody else publishes a frame that is ours to publish: tf would jump between the two.
class TfRivals {
 public:
  /// Called once for each frame and each rival, from the thread that serves `nh`.
  /// @param frame  of ours: the child of the rival's transform
  /// @param words  who publishes it, and what to do
  using Callback = std::function<void(const std::string& frame, const std::string& words)>;

  TfRivals(ros::NodeHandle nh, const FrameNames& frames, Callback on_rival);

 private:
  void onTransforms(const ros::MessageEvent<const tf2_msgs::TFMessage>& event);

  const FrameNames frames_;
  const Callback on_rival_;
  std::set<std::string> known_;  // rival and frame
  std::vector<ros::Subscriber> subscribers_;
};

}  // namespace cocalib
