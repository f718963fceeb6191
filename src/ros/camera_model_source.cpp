#include "cocalib/ros/camera_model_source.h"

#include <ros/console.h>
#include <ros/master.h>

#include <utility>

#include "cocalib/ros/camera_info.h"

namespace cocalib {
namespace {

constexpr double kReminderS = 5.0;

}  // namespace

CameraModelSource::CameraModelSource(ros::NodeHandle nh, const RigConfig& rig, Callback on_model)
    : on_model_(std::move(on_model)) {
  if (!rig.camera || rig.camera->model) {
    on_model_(rig.camera ? rig.camera->model : std::nullopt);
    return;
  }
  topic_ = rig.camera->info_topic;
  missing_ = "waiting for the camera model on " + topic_ +
             "; start the camera's driver, or name model, intrinsics and distortion in the rig file";
  ROS_INFO("%s", missing_.c_str());
  reminder_ = nh.createWallTimer(ros::WallDuration(kReminderS),
                                 [this](const ros::WallTimerEvent&) { ROS_WARN("%s", missing().c_str()); });
  const std::lock_guard<std::mutex> lock(mutex_);  // the first message may come before the assignment
  subscriber_ = nh.subscribe(topic_, 5, &CameraModelSource::onInfo, this);
}

std::string CameraModelSource::missing() const {
  const std::lock_guard<std::mutex> lock(mutex_);
  return missing_;
}

void CameraModelSource::onInfo(const sensor_msgs::CameraInfo& msg) {
  if (!on_model_) return;
  std::string problem;
  const std::optional<CameraModel> model = readCameraInfo(msg, &problem);
  if (!model) return complain("waiting for a camera model: what comes on " + topic_ + " cannot be used: " + problem);
  reminder_.stop();
  const Callback on_model = std::exchange(on_model_, nullptr);
  on_model(model);
  const std::lock_guard<std::mutex> lock(mutex_);
  missing_.clear();
  subscriber_.shutdown();
}

void CameraModelSource::complain(const std::string& words) {
  const std::lock_guard<std::mutex> lock(mutex_);
  if (words != missing_) ROS_WARN("%s", words.c_str());
  missing_ = words;
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
