#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <vector>

#include "cocalib/geometry/plane.h"
#include "cocalib/geometry/pose.h"

namespace cocalib {

/// The part of a plane that one sweep shows.
struct PlanePatch {
  int number = -1;  ///< of the plane
  Plane plane_W;
  Pose T_W_P;  ///< middle of the patch; z along the plane's normal
  double length_m = 0.0, width_m = 0.0;
  int points = 0;
};

/// A plane through the points of each number in a deskewed sweep, with their extent; only those of 50 points and more.
/// @param plane_of  number of each point's plane, -1: none
std::vector<PlanePatch> fitPatches(const std::vector<Eigen::Vector3f>& points_W,
                                   const std::vector<std::int16_t>& plane_of);

/// Distance of every point to the patch of its plane [m], >= 0; -1 where there is none.
std::vector<float> distancesToPatches(const std::vector<Eigen::Vector3f>& points_W,
                                      const std::vector<std::int16_t>& plane_of,
                                      const std::vector<PlanePatch>& patches);

}  // namespace cocalib
