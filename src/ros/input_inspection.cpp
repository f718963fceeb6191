#include "cocalib/ros/input_inspection.h"

#include <algorithm>

#include "cocalib/ros/camera_info.h"
#include "cocalib/ros/conversions.h"
#include "cocalib/ros/imu_reader.h"

namespace cocalib {
namespace {

constexpr int kCloudsRead = 8;  // enough to know a driver; parsing them all would double the work
constexpr int kMostRefused = 4;

InputDoctor::Topics topicsOf(const RigConfig& rig) {
  return {rig.imu.topic, rig.camera ? rig.camera->topic : "", rig.lidar ? rig.lidar->topic : ""};
}

}  // namespace

InputInspection::InputInspection(const RigConfig& rig) : rig_(rig), doctor_(topicsOf(rig)) {
  if (rig.lidar) reader_.emplace(*rig.lidar);
}

void InputInspection::setCamera(const std::optional<CameraModel>& camera) {
  camera_ = camera;
  if (camera) board_.setPictureSize(camera->width(), camera->height());
}

void InputInspection::addCameraInfo(const sensor_msgs::CameraInfo& msg) {
  if (!camera_info_) {
    std::string problem;
    if (readCameraInfo(msg, &problem)) camera_info_ = msg;
    return;
  }
  const sensor_msgs::CameraInfo& first = *camera_info_;
  const bool same = msg.width == first.width && msg.height == first.height && msg.K == first.K && msg.D == first.D &&
                    msg.distortion_model == first.distortion_model;
  if (same) return;
  doctor_.report({"camera_info", rig_.camera->info_topic + ": it has changed while running; the first one is used on",
                  "keep zoom, focus and resolution as they are; calibrate the lens as it is now, and start again",
                  Finding::Weight::kError});
}

void InputInspection::addImu(const sensor_msgs::Imu& msg, TimeNs received) {
  const std::optional<ImuSample> sample = readImu(msg, nullptr);
  if (!sample) return;
  doctor_.addImu(*sample, received);
  doctor_.compareFrames("imu", rig_.imu.topic, msg.header.frame_id, rig_.imu.frame);
  motion_.add(*sample);
}

void InputInspection::addImage(const sensor_msgs::Image& msg, TimeNs received) {
  doctor_.addImage(toTimeNs(msg.header.stamp), received);
  doctor_.compareFrames("camera", rig_.camera->topic, msg.header.frame_id, rig_.camera->frame);
  if (!camera_ || msg.width > 65536 || msg.height > 65536) return;
  doctor_.compareSizes(static_cast<int>(msg.width), static_cast<int>(msg.height), camera_->width(), camera_->height());
}

void InputInspection::addImage(const sensor_msgs::CompressedImage& msg, TimeNs received) {
  doctor_.addImage(toTimeNs(msg.header.stamp), received);
  doctor_.compareFrames("camera", rig_.camera->topic, msg.header.frame_id, rig_.camera->frame);
}

void InputInspection::addCloud(const sensor_msgs::PointCloud2& msg, TimeNs received) {
  doctor_.addSweep(toTimeNs(msg.header.stamp), received, spanOf(msg));
  doctor_.compareFrames("lidar", rig_.lidar->topic, msg.header.frame_id, rig_.lidar->frame);
}

std::optional<double> InputInspection::spanOf(const sensor_msgs::PointCloud2& msg) {
  if (clouds_read_ >= kCloudsRead) return std::nullopt;
  ++clouds_read_;
  std::string problem;
  const std::optional<LidarScan> scan = reader_->read(msg, &problem);
  if (scan && !scan->points.empty()) {
    const auto [first, last] =
        std::minmax_element(scan->points.begin(), scan->points.end(),
                            [](const LidarPoint& a, const LidarPoint& b) { return a.offset_s < b.offset_s; });
    return last->offset_s - first->offset_s;
  }
  if (++clouds_refused_ == kMostRefused) {
    doctor_.report({"lidar clouds", rig_.lidar->topic + ": " + (scan ? "no usable point" : problem),
                    "check the driver, or lidar: min_range, max_range and point_time in the rig file",
                    Finding::Weight::kError});
  }
  return std::nullopt;
}

void InputInspection::restart() {
  doctor_.restart();
  motion_.clear();
  board_.clear();
}

std::vector<std::string> InputInspection::words() const {
  std::vector<std::string> lines;
  for (const Finding& finding : doctor_.findings()) lines.push_back(finding.words());
  return lines;
}

}  // namespace cocalib
