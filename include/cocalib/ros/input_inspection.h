#pragma once

#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>

#include <optional>
#include <string>
#include <vector>

#include "cocalib/io/rig_config.h"
#include "cocalib/monitor/coverage.h"
#include "cocalib/monitor/input_doctor.h"
#include "cocalib/ros/point_cloud_reader.h"

namespace cocalib {

/// Shows the messages of a run to the input doctor, and keeps what the report says of the input. The nodelet and the
/// bag runner drive this same class. Not thread-safe. `received`: as for InputDoctor.
class InputInspection {
 public:
  explicit InputInspection(const RigConfig& rig);

  /// @param camera  nothing for a rig without
  void setCamera(const std::optional<CameraModel>& camera);
  /// Of a rig whose camera model comes from there: the first usable one counts, and is not to change afterwards.
  void addCameraInfo(const sensor_msgs::CameraInfo& msg);
  void addImu(const sensor_msgs::Imu& msg, TimeNs received);
  void addImage(const sensor_msgs::Image& msg, TimeNs received);
  void addImage(const sensor_msgs::CompressedImage& msg, TimeNs received);
  void addCloud(const sensor_msgs::PointCloud2& msg, TimeNs received);
  void addKeyframe(const VisualKeyframe& keyframe) { board_.add(keyframe); }
  /// The clock was set back, or a new calibration begins.
  void restart();

  InputDoctor& doctor() { return doctor_; }
  const InputDoctor& doctor() const { return doctor_; }
  /// All findings so far, one line each.
  std::vector<std::string> words() const;
  const MotionCoverage& motion() const { return motion_; }
  const BoardCoverage& board() const { return board_; }

 private:
  std::optional<double> spanOf(const sensor_msgs::PointCloud2& msg);

  const RigConfig rig_;
  InputDoctor doctor_;
  MotionCoverage motion_;
  BoardCoverage board_;
  std::optional<CameraModel> camera_;
  std::optional<sensor_msgs::CameraInfo> camera_info_;  // the first usable one
  std::optional<PointCloudReader> reader_;
  int clouds_read_ = 0, clouds_refused_ = 0;
};

}  // namespace cocalib
