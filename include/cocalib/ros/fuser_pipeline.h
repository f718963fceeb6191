#pragma once

#include <sensor_msgs/Imu.h>

#include <optional>
#include <vector>

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/io/rig_config.h"
#include "cocalib/monitor/mounting_watch.h"
#include "cocalib/ros/imu_stream.h"
#include "cocalib/ros/notices.h"

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

  /// Holds the calibration as it is: from now on data only show whether it still fits. Until reset().
  void freeze();
  bool frozen() const { return watch_.has_value(); }
  /// What the newest data contradict; may take a second. Nothing unless frozen.
  std::vector<MountingChange> watch();

  CoCalibrationFuser& fuser() { return fuser_; }
  /// The fuser's words and counters together with this pipeline's.
  CalibratorDiagnostics diagnostics() const;

 private:
  const FuserParams params_;
  const ImuNoise imu_noise_;
  const FuserInputs inputs_;
  CoCalibrationFuser fuser_;
  std::optional<MountingWatch> watch_;
  ImuStream imu_;
  Notices notices_;
};

}  // namespace cocalib
