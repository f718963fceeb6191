#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "cocalib/initialization/open_start.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// From the pictures' measurements to a first mounting of the camera: rotations from the board where it is seen and from
/// tracks elsewhere, then lever arm, gravity and velocities from board poses, or from tracks. Remembers what two
/// pictures show of a turn, which costs most: the next attempt has most of its pictures in common with the last. Not
/// thread-safe.
class CameraExploration {
 public:
  CameraExploration(const CameraModel& camera, const std::optional<BoardGeometry>& board)
      : camera_(camera), board_(board) {}

  /// @return nothing while the motion does not determine the whole mounting; `reason` says why, in words for the user
  std::optional<Alignment> align(const ImuBuffer& imu, const std::vector<VisualKeyframe>& frames,
                                 std::string* reason);
  /// The same, but what the motion leaves open is taken from the guess, or, without one, from a broad prior.
  std::optional<Alignment> alignOpenly(const ImuBuffer& imu, const std::vector<VisualKeyframe>& frames,
                                       const std::optional<Pose>& guess_T_imu_camera, std::string* reason);
  /// After which pictures with the same stamps may show something else.
  void forget() { turns_.clear(); }

  /// The pictures show enough that, where nothing can be aligned, the motion is what is missing.
  bool seesEnough(const std::vector<VisualKeyframe>& frames) const;

 private:
  std::vector<SensorPose> boardPoses(const std::vector<VisualKeyframe>& frames) const;
  std::vector<RelativeSensorRotation> rotations(const std::vector<VisualKeyframe>& frames,
                                                const std::vector<SensorPose>& board_poses);
  const std::optional<Eigen::Quaterniond>& turnBetween(const VisualKeyframe& a, const VisualKeyframe& b);
  std::vector<BearingFrame> bearings(const std::vector<VisualKeyframe>& frames) const;
  SensorMotion ownMotion(const std::vector<VisualKeyframe>& frames);
  std::optional<Alignment> alignFrom(const ImuBuffer& imu, const SensorMotion& motion, const OpenStart& start,
                                     std::string* reason) const;

  CameraModel camera_;
  std::optional<BoardGeometry> board_;
  std::map<std::pair<TimeNs, TimeNs>, std::optional<Eigen::Quaterniond>> turns_;  ///< by stamps: R_a_b, from tracks
};

/// The frame with its natural features only if it is the first within its 1 / rate_hz of the clock, without them
/// otherwise: errors of a track are correlated in time, so more observations cost more than they tell.
VisualKeyframe thinTracks(const VisualKeyframe& frame, double rate_hz);

}  // namespace cocalib
