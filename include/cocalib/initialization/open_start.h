#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/initialization/alignment.h"
#include "cocalib/initialization/rotation_initializer.h"

namespace cocalib {

/// What a sensor has seen of its own motion.
struct SensorMotion {
  std::vector<RelativeSensorRotation> rotations;
  std::vector<SensorPose> poses;       ///< metric ones; may be empty
  std::vector<BearingFrame> bearings;  ///< in place of poses
  double position_sigma_m = 0.02;
};

/// From where an alignment can begin.
struct OpenStart {
  RotationInitialization rotation;
  AlignmentParams alignment;
};

/// For motion that does not show the whole mounting. The rotation comes from rotations alone where they do determine
/// it, else from rates and accelerations (or tracks) together, else from the guess. The lever arm's prior is the
/// guess's, or, without one, that of a place anywhere on the rig. A guess whose rotation the motion contradicts is not
/// used.
/// @return nothing if the rotation stays open too; `reason` says what is missing, in words for the user
std::optional<OpenStart> openStart(const ImuBuffer& imu, const SensorMotion& motion, const std::optional<Pose>& guess,
                                   std::string* reason);

}  // namespace cocalib
