#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/initialization/alignment.h"
#include "cocalib/initialization/rotation_initializer.h"

namespace cocalib {

/// Mounting rotation, clock offset and gyro bias for motion whose rotations alone leave the mounting open: turning
/// about one axis, or not at all. What rotations do not say comes from the accelerometer against the accelerations of
/// the sensor's positions. Accepted only where a single rotation fits, and its sigma is small; the clock offset stays
/// at 0 where neither rates nor accelerations tell it.
/// @param position_sigma_m  noise of the positions
/// @return nothing where the motion does not show the rotation; `reason` says what is missing, in words for the user
std::optional<RotationInitialization> rotationFromMotion(const ImuBuffer& imu, const std::vector<SensorPose>& poses,
                                                         double position_sigma_m,
                                                         const RotationInitializerParams& params,
                                                         std::string* reason = nullptr);

}  // namespace cocalib
