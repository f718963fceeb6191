#pragma once

#include <optional>
#include <vector>

#include "cocalib/monitor/overlay_scene.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// The board as each sensor by itself sees it, in the camera's frame at the time of the picture: where the calibration
/// is right, they meet.
struct BoardViews {
  TimeNs stamp = 0;                      ///< of the picture, camera clock
  Pose T_C_B;                            ///< that the picture's corners give
  std::vector<Eigen::Vector3d> plate_C;  ///< returns of the lidar on the plate
  std::vector<Eigen::Vector3d> rim_C;    ///< of them, the last ones before its edge; none for a lidar without rings
};

/// @param corners      in the scene's picture
/// @param calibration  carries the lidar's returns to the camera, and says where in the sweep to look for the plate
/// @return nothing if the corners give no pose; no returns if no plate is found where the camera sees it
std::optional<BoardViews> viewBoard(const OverlayScene& scene, const BoardObservation& corners,
                                    const Calibration& calibration, const CameraModel& camera,
                                    const BoardGeometry& board, double range_noise_m);

}  // namespace cocalib
