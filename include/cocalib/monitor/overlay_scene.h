#pragma once

#include <optional>
#include <vector>

#include "cocalib/estimation/estimate.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// A picture and a sweep of about the same time, with what brings them together.
struct OverlayScene {
  ImageFrame image;
  LidarScan scan;
  std::vector<ImuSample> imu;     ///< covers both, as far as it was there
  std::optional<NavState> state;  ///< of the IMU at about the sweep's time; gives velocity and biases
};

/// The sweep's points in the camera frame at the time of the picture: every point is carried from its own time by the
/// gyro's rotation and the state's velocity.
std::vector<Eigen::Vector3d> pointsInCamera(const OverlayScene& scene, const Calibration& calibration);

/// The board in the camera frame at the time of the picture.
/// @param T_W_B  in the world of the scene's state
/// @return nothing without a state or a board
std::optional<Pose> boardInCamera(const OverlayScene& scene, const Calibration& calibration,
                                  const std::optional<Pose>& T_W_B);

}  // namespace cocalib
