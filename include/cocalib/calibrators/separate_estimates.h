#pragma once

#include <optional>

#include "cocalib/estimation/estimate.h"

namespace cocalib {

/// A calibrator to whom the motion shows nothing keeps the fuser from starting: the estimate is then what the
/// calibrators say, side by side, without what they would say of each other.
/// @param camera, lidar  their estimates; null: the rig has no such sensor
/// @return nothing unless each has an estimate and one of them shows nothing
std::optional<CalibrationEstimate> unseenSideBySide(const CalibrationEstimate* camera,
                                                    const CalibrationEstimate* lidar);

/// 1 sigma [m] to which the fuser holds a lever arm about its start. What the motion leaves open is as certain as the
/// calibrator's own start, which had a guess or had none.
double leverPrior(const SensorVerdict& verdict);

}  // namespace cocalib
