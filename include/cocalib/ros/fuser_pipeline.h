#pragma once

#include <sensor_msgs/Imu.h>

#include <optional>

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/io/rig_config.h"
#include "cocalib/ros/notices.h"
#include "cocalib/ros/stream_guard.h"

namespace cocalib {

/// The fuser behind messages: refuses keyframes of another run, starts over when the clock is set back. The nodelet and
/// the bag runner drive this same class. Not thread-safe.
class FuserPipeline {
 public:
  /// @param camera  model of the camera; nothing for a rig without
  FuserPipeline(const RigConfig& rig, const std::optional<CameraModel>& camera, FuserParams params = {});

  /// @return true if the clock was set back and everything started over
  bool addImu(const sensor_msgs::Imu& msg);
  void addVisual(VisualKeyframe keyframe);
  void addLidar(LidarKeyframe keyframe);
  void reset();

  CoCalibrationFuser& fuser() { return fuser_; }
  /// The fuser's words and counters together with this pipeline's.
  CalibratorDiagnostics diagnostics() const;

 private:
  CoCalibrationFuser fuser_;
  StreamGuard guard_;
  Notices notices_;
};

}  // namespace cocalib
