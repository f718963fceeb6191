#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/initialization/alignment.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// From the pictures' measurements to a first mounting of the camera: rotations from the board where it
/// is seen and from tracks elsewhere, then lever arm, gravity and velocities from board poses, or from tracks.
class CameraExploration {
 public:
  CameraExploration(const CameraModel& camera, const std::optional<BoardGeometry>& board)
      : camera_(camera), board_(board) {}

  /// @param guess_T_imu_camera  stands in for what the motion leaves open; nothing: the motion must show everything
  /// @return nothing while the motion does not determine it; `reason` says why, in words for the user
  std::optional<Alignment> align(const ImuBuffer& imu, const std::vector<VisualKeyframe>& frames,
                                 const std::optional<Pose>& guess_T_imu_camera, std::string* reason) const;

 private:
  std::vector<SensorPose> boardPoses(const std::vector<VisualKeyframe>& frames) const;
  std::vector<RelativeSensorRotation> rotations(const std::vector<VisualKeyframe>& frames,
                                                const std::vector<SensorPose>& board_poses) const;

  CameraModel camera_;
  std::optional<BoardGeometry> board_;
};

/// The frame with its natural features only if it is the first within its 1 / rate_hz of the clock, without them
/// otherwise: errors of a track are correlated in time, so more observations cost more than they tell.
VisualKeyframe thinTracks(const VisualKeyframe& frame, double rate_hz);

}  // namespace cocalib
