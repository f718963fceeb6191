#pragma once

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>

#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/monitor/progress.h"
#include "cocalib/ros/input_inspection.h"
#include "cocalib/ros/result_files.h"

namespace cocalib {

/// What a live calibration says in words: what the input doctor finds, and the state of the calibration in one line
/// with what is still needed. All functions may be called from any thread.
class LiveStatus {
 public:
  explicit LiveStatus(const RigConfig& rig);

  void setCamera(const std::optional<CameraModel>& camera);
  void addCameraInfo(const sensor_msgs::CameraInfo& msg);
  void addImu(const sensor_msgs::Imu& msg);
  template <typename ImageMsg>
  void addImage(const ImageMsg& msg) {
    const TimeNs received = now();
    const std::lock_guard<std::mutex> lock(mutex_);
    inspection_.addImage(msg, received);
  }
  void addCloud(const sensor_msgs::PointCloud2& msg);
  void addKeyframe(const VisualKeyframe& keyframe);
  /// What another part of the system has found.
  void report(Finding finding);
  /// @param stage  what the estimator is doing
  void setEstimate(const CalibrationEstimate& estimate, const std::string& stage);
  void restart();

  /// Puts new findings into the log. To be called about once a second; notices what does not come, too.
  /// @return whether there were any
  bool logFindings();
  /// The state in one line.
  std::string words() const;
  /// Only what it is and what to do, for the picture.
  std::string headline() const;
  std::optional<MotionHint> hint() const;
  std::vector<std::string> findings() const;
  /// What the report says of the input.
  void fill(RunResult* result) const;

 private:
  static TimeNs now();
  bool awaitsSensor() const;

  const RigConfig rig_;
  mutable std::mutex mutex_;  // guards what follows
  InputInspection inspection_;
  ProgressForecast forecast_;
  CalibrationEstimate estimate_;
  std::string stage_;
};

}  // namespace cocalib
