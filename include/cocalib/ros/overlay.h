#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>

#include "cocalib/monitor/overlay_scene.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// What is drawn with: a calibration, and the board in the world of the scene's state (for its outline).
struct OverlayCalibration {
  Calibration calibration;
  std::optional<Pose> T_W_B;
  std::string caption;
};

/// How many points fall into the picture, and how many of these onto the board.
struct OverlayCounts {
  int visible = 0;
  int on_board = 0;
  bool whole_board = false;  ///< all of it is in the picture
};
OverlayCounts countOverlay(const OverlayScene& scene, const OverlayCalibration& with, const CameraModel& camera,
                           const std::optional<BoardGeometry>& board);

/// The picture with the sweep over it, near points red, far ones blue, and the outline of the board. BGR.
cv::Mat drawOverlay(const OverlayScene& scene, const OverlayCalibration& with, const CameraModel& camera,
                    const std::optional<BoardGeometry>& board);

/// What is assumed of a rig of which nothing is known, to show "before": the camera looks along the IMU's x axis with
/// its picture upright, the lidar is parallel to the IMU, and all stand in one place. Parts the user gave replace it.
Calibration nominalCalibration(const std::optional<Pose>& guess_T_imu_camera,
                               const std::optional<Pose>& guess_T_imu_lidar);

}  // namespace cocalib
