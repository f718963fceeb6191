#pragma once

#include <visualization_msgs/MarkerArray.h>

#include <optional>
#include <string>
#include <vector>

#include "cocalib/estimation/estimate.h"
#include "cocalib/lidar/plane_patch.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/monitor/progress.h"
#include "cocalib/ros/estimate_conversions.h"

namespace cocalib {

/// Markers for rviz: the plate with its squares (in the world frame), and the sensor mountings as axes with their names
/// (in the IMU frame), each with the ellipsoid of three sigma of its position.
visualization_msgs::MarkerArray toMarkers(const CalibrationEstimate& estimate, const std::optional<Pose>& T_W_B,
                                          const std::optional<BoardGeometry>& board, const FrameNames& frames);

/// The words for the user above the rig, and an arrow with a ring about it for the rotation that would help most; what
/// stood there before goes.
void addHint(const std::string& words, const std::optional<MotionHint>& hint, const FrameNames& frames,
             visualization_msgs::MarkerArray* all);

/// Thin, see-through boxes, one a patch; they go by themselves after two seconds.
visualization_msgs::MarkerArray toPatchMarkers(const std::vector<PlanePatch>& patches, TimeNs stamp,
                                               const std::string& world_frame);

}  // namespace cocalib
