#pragma once

#include <opencv2/core/mat.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/estimation/estimate.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// A picture and a sweep of about the same time, with what brings them together.
struct OverlayScene {
  ImageFrame image;
  LidarScan scan;
  std::vector<ImuSample> imu;     ///< covers both, as far as it was there
  std::optional<NavState> state;  ///< of the IMU at about the sweep's time; gives velocity and biases
};

/// What is drawn with: a calibration, and the board in the world of the scene's state (for its outline).
struct OverlayCalibration {
  Calibration calibration;
  std::optional<Pose> T_W_B;
  std::string caption;
};

/// The sweep's points in the camera frame at the time of the picture: every point is carried from its own time by the
/// gyro's rotation and the state's velocity.
std::vector<Eigen::Vector3d> pointsInCamera(const OverlayScene& scene, const Calibration& calibration);

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
