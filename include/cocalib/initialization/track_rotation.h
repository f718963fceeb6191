#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/initialization/alignment.h"
#include "cocalib/initialization/rotation_initializer.h"

namespace cocalib {

/// The turn about the one axis that all rotations share, for a camera without metric poses: bearings of tracks and the
/// IMU's path agree at the right angle only. Every angle is tried with the linear alignment of tracks, then finer.
/// @return nothing unless one angle is distinctly the best; `reason` says so
std::optional<RotationInitialization> rotationFromTracks(const ImuBuffer& imu, const AxisRotation& turning,
                                                         const std::vector<BearingFrame>& frames,
                                                         std::string* reason = nullptr);

}  // namespace cocalib
