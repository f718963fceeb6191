#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// Least squares of the reprojection from a start near the truth, over the corners that are there.
/// @param corners_px  one entry a corner of the board; at least 4 of them filled
/// @param rms_px      where to put the RMS reprojection error, or null
/// @return nothing where the start cannot be projected or too few corners are there
std::optional<Pose> refineBoardPose(const Pose& start_T_C_B,
                                    const std::vector<std::optional<Eigen::Vector2d>>& corners_px,
                                    const BoardGeometry& board, const CameraModel& camera, double* rms_px = nullptr);

}  // namespace cocalib
