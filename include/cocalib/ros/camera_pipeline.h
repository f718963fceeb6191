#pragma once

#include <sensor_msgs/CompressedImage.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>

#include <optional>
#include <string>
#include <vector>

#include "cocalib/calibrators/visual_inertial_calibrator.h"
#include "cocalib/io/rig_config.h"
#include "cocalib/ros/board_size_check.h"
#include "cocalib/ros/imu_stream.h"
#include "cocalib/ros/notices.h"

namespace cocalib {

/// From messages to visual keyframes: reads, refuses what is broken and counts it, starts over when the clock is set
/// back, and hands the rest to the calibrator. The nodelet and the bag runner drive this same class. Not thread-safe.
class CameraPipeline {
 public:
  /// @throws std::invalid_argument if the rig has no camera
  CameraPipeline(const RigConfig& rig, const CameraModel& camera, const VisualInertialParams& params = {});

  void addImu(const sensor_msgs::Imu& msg);
  std::vector<VisualKeyframe> addImage(const sensor_msgs::Image& msg) { return addAnyImage(msg); }
  std::vector<VisualKeyframe> addImage(const sensor_msgs::CompressedImage& msg) { return addAnyImage(msg); }
  void reset();

  VisualInertialCalibrator& calibrator() { return calibrator_; }
  Notices& notices() { return notices_; }
  /// The calibrator's words and counters together with this pipeline's.
  CalibratorDiagnostics diagnostics() const;
  /// In one line, what the rig file says wrongly of the board or the picture; nothing while all is well.
  const std::optional<std::string>& rigProblem() const { return rig_problem_; }

 private:
  template <typename Message>
  std::vector<VisualKeyframe> addAnyImage(const Message& msg);
  bool fitsModel(const cv::Mat& gray);

  std::string rig_file_, topic_;
  int width_, height_;
  VisualInertialCalibrator calibrator_;
  std::optional<BoardSizeCheck> board_check_;
  ImuStream imu_;
  Notices notices_;
  std::optional<std::string> rig_problem_;
};

}  // namespace cocalib
