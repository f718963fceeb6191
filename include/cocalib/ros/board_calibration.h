#pragma once

#include <functional>
#include <optional>
#include <string>

#include "cocalib/initialization/lidar_camera_initializer.h"
#include "cocalib/io/rig_config.h"

namespace cocalib {

/// What a recording of boards at rest gives.
struct BoardCalibration {
  int images = 0, images_with_board = 0;  ///< pictures looked at, and those in which the chessboard was found
  int clouds = 0, clouds_with_plate = 0;  ///< sweeps of these pictures, and those with a patch of the plate's size
  std::optional<LidarCameraStart> start;  ///< nothing: not determined
  std::string reason;                     ///< then: what is missing
};

/// Lidar against camera from a bag in which rig and board stand still for every view; needs no IMU. A picture and a
/// sweep make a view when their stamps are within 50 ms; views less than half a second apart are passed over.
///
/// @param progress  called with the views done and in total; may be empty
/// @throws std::runtime_error with one line: which file, key or topic, why, and what to do
BoardCalibration calibrateFromBoards(const std::string& bag_file, const RigConfig& rig,
                                     const std::function<void(int, int)>& progress = {});

/// lidar_camera.yaml as text: the transform, its sigma, and how well the views agree.
/// @pre calibration.start has a value
std::string formatBoardCalibration(const BoardCalibration& calibration);

}  // namespace cocalib
