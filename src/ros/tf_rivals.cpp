#include "cocalib/ros/tf_rivals.h"

#include <ros/this_node.h>

#include <utility>

namespace cocalib {
namespace {

std::string withoutSlash(const std::string& frame) {
  return !frame.empty() && frame.front() == '/' ? frame.substr(1) : frame;
}

}  // namespace

TfRivals::TfRivals(ros::NodeHandle nh, const FrameNames& frames, Callback on_rival)
    : frames_(frames), on_rival_(std::move(on_rival)) {
  subscribers_ = {nh.subscribe("/tf", 100, &TfRivals::onTransforms, this),
                  nh.subscribe("/tf_static", 100, &TfRivals::onTransforms, this)};
}

void TfRivals::onTransforms(const ros::MessageEvent<const tf2_msgs::TFMessage>& event) {
  const std::string& who = event.getPublisherName();
  if (who == ros::this_node::getName()) return;
  for (const geometry_msgs::TransformStamped& transform : event.getMessage()->transforms) {
    const std::string child = withoutSlash(transform.child_frame_id);
    if (child != frames_.imu && child != frames_.camera && child != frames_.lidar) continue;
    if (!known_.insert(who + " " + child).second) continue;
    on_rival_(child, who + " publishes the transform " + withoutSlash(transform.header.frame_id) + " -> " + child +
                         " too, so it is left to it; to see the calibration in tf, stop that publisher (or take the "
                         "joint out of the robot's description)");
  }
}

}  // namespace cocalib
