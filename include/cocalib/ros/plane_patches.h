#pragma once

#include <visualization_msgs/MarkerArray.h>

#include <string>
#include <vector>

#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/geometry/plane.h"

namespace cocalib {

/// The part of a plane that one sweep shows.
struct PlanePatch {
  int number = -1;  ///< as in DeskewedCloud::plane
  Plane plane_W;
  Pose T_W_P;  ///< middle of the patch; z along the plane's normal
  double length_m = 0.0, width_m = 0.0;
  int points = 0;
};

/// A plane through the points of each number in a deskewed sweep, with their extent; only those of 50 points and more.
std::vector<PlanePatch> fitPatches(const DeskewedCloud& cloud);

/// Distance of every point of the sweep to the patch of its plane [m], >= 0; -1 where there is none.
std::vector<float> distancesToPatches(const DeskewedCloud& cloud, const std::vector<PlanePatch>& patches);

/// Thin, see-through boxes, one a patch; they go by themselves after two seconds.
visualization_msgs::MarkerArray toPatchMarkers(const std::vector<PlanePatch>& patches, TimeNs stamp,
                                               const std::string& world_frame);

}  // namespace cocalib
