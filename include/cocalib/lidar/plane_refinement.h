#pragma once

#include <vector>

#include "cocalib/lidar/moment_voxels.h"
#include "cocalib/lidar/plane_growing.h"
#include "cocalib/lidar/plane_map.h"
#include "cocalib/lidar/plane_territory.h"

namespace cocalib {

/// A plane fitted to pure columns.
struct RefinedPlane {
  Plane plane;
  PointMoments support;             ///< of the points in pure columns; none: the plane only guards its surroundings
  std::vector<Voxel> surroundings;  ///< voxels near the plane's surface
  std::vector<Voxel> pure;          ///< voxels in which its points can be told from all else
};

/// Fits each region's plane to the columns of voxels (along the main axis of its normal) that cross the whole noise of
/// the plane and hold nothing else: mean and thickness agree with the noise and no other plane passes through. The
/// order of the regions is kept; a plane without a pure column keeps the region's fit and has no support.
std::vector<RefinedPlane> refinePlanes(const MomentVoxels& voxels, const std::vector<PlaneRegion>& regions,
                                       const PlaneMap::Params& params);

}  // namespace cocalib
