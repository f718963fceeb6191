#pragma once

#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/io/rig_config.h"
#include "cocalib/ros/imu_stream.h"
#include "cocalib/ros/notices.h"
#include "cocalib/ros/point_cloud_reader.h"

namespace cocalib {

/// From messages to lidar keyframes, as CameraPipeline for the camera. Not thread-safe.
class LidarPipeline {
 public:
  /// @throws std::invalid_argument if the rig has no lidar
  explicit LidarPipeline(const RigConfig& rig, LidarInertialParams params = {});

  void addImu(const sensor_msgs::Imu& msg);
  /// @param look  see LidarInertialCalibrator::addScan()
  std::vector<LidarKeyframe> addCloud(const sensor_msgs::PointCloud2& msg, const std::function<void()>& look = nullptr);
  void reset();

  LidarInertialCalibrator& calibrator() { return calibrator_; }
  Notices& notices() { return notices_; }
  /// The calibrator's words and counters together with this pipeline's.
  CalibratorDiagnostics diagnostics() const;
  /// In one line, why none of the clouds so far could be used; nothing when one could, or none has come.
  std::optional<std::string> inputProblem() const;

 private:
  std::string topic_;
  PointCloudReader reader_;
  LidarInertialCalibrator calibrator_;
  ImuStream imu_;
  Notices notices_;
  std::string last_problem_;
};

}  // namespace cocalib
