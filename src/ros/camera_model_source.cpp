#include "cocalib/ros/camera_model_source.h"

#include <ros/console.h>
#include <ros/master.h>

#include <utility>

#include "cocalib/ros/camera_info.h"

namespace cocalib {

CameraModelSource::CameraModelSource(ros::NodeHandle nh, const RigConfig& rig, Callback on_model)
    : on_model_(std::move(on_model)) {
  if (!rig.camera || rig.camera->model) {
    on_model_(rig.camera ? rig.camera->model : std::nullopt);
    return;
  }
  topic_ = rig.camera->info_topic;
  ROS_INFO("waiting for the camera model on %s", topic_.c_str());
  subscriber_ = nh.subscribe(topic_, 5, &CameraModelSource::onInfo, this);
}

void CameraModelSource::onInfo(const sensor_msgs::CameraInfo& msg) {
  if (!on_model_) return;
  std::string problem;
  const std::optional<CameraModel> model = readCameraInfo(msg, &problem);
  if (!model) {
    ROS_WARN_THROTTLE(5.0, "%s: %s", topic_.c_str(), problem.c_str());
    return;
  }
  const Callback on_model = std::exchange(on_model_, nullptr);
  on_model(model);
  subscriber_.shutdown();
}

bool isCompressedTopic(const std::string& topic) {
  ros::master::V_TopicInfo topics;
  if (ros::master::getTopics(topics)) {
    for (const ros::master::TopicInfo& info : topics) {
      if (info.name == topic && info.datatype != "*") return info.datatype == "sensor_msgs/CompressedImage";
    }
  }
  const std::string ending = "/compressed";
  return topic.size() >= ending.size() && topic.compare(topic.size() - ending.size(), ending.size(), ending) == 0;
}

}  // namespace cocalib
