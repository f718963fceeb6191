#pragma once

#include <visualization_msgs/MarkerArray.h>

#include <optional>
#include <string>

#include "cocalib/estimation/estimate.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/ros/estimate_conversions.h"

namespace cocalib {

/// Markers for rviz: the plate with its squares (in the world frame), the sensor mountings as axes (in the IMU frame)
/// each with the ellipsoid of three sigma of its position, and the words for the user above the rig.
visualization_msgs::MarkerArray toMarkers(const CalibrationEstimate& estimate, const std::string& words,
                                          const std::optional<Pose>& T_W_B, const std::optional<BoardGeometry>& board,
                                          const FrameNames& frames);

}  // namespace cocalib
