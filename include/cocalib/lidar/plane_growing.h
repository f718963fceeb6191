#pragma once

#include <vector>

#include "cocalib/lidar/moment_voxels.h"
#include "cocalib/lidar/plane_map.h"

namespace cocalib {

/// Flat voxels that lie in one plane.
struct PlaneRegion {
  Plane plane;
  PointMoments moments;      ///< of all points in the voxels
  std::vector<int> members;  ///< numbers of the voxels
};

/// Finds planes by growing regions of flat voxels from the best-supported ones, then joins regions that are coplanar
/// across gaps. Most supported first; regions that cover less than the smallest plane's area are left out.
/// The planes are good to a part of the noise: what lies on the faces between voxels and at edges is still to be
/// judged.
std::vector<PlaneRegion> growPlanes(const MomentVoxels& voxels, const PlaneMap::Params& params);

}  // namespace cocalib
