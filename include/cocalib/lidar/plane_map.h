#pragma once

#include <cstdint>
#include <memory>
#include <unordered_map>
#include <vector>

#include <Eigen/Core>

#include "cocalib/geometry/plane.h"

namespace cocalib {

/// Large planes of a scene and which voxels of space belong to each.
///
/// Points (world frame, deskewed) are gathered in voxels; voxels whose points are flat are joined with coplanar
/// neighbours by region growing. Voxels at an intersection (not flat) belong to no plane, so that an
/// association by voxel never mixes two planes. Planes are numbered by size, most supported first.
/// Not thread-safe. Deterministic (results depend on the points and their order only).
class PlaneMap {
 public:
  struct Params {
    double voxel_m = 0.4;
    double point_sigma_m = 0.03;      ///< noise of a point along the plane normal, 1 sigma
    int min_voxel_points = 12;
    double max_normal_angle_rad = 0.12;   ///< between a voxel and the plane that it joins
    double min_plane_area_m2 = 0.3;
    int max_planes = 60;
  };
  explicit PlaneMap(const Params& params);
  ~PlaneMap();

  void addPoint(const Eigen::Vector3d& p_W);
  /// Finds the planes of all points added so far; existing planes are found anew.
  void extract();
  /// Forgets points and planes.
  void clear();

  int planeCount() const { return static_cast<int>(planes_.size()); }
  const std::vector<Plane>& planes() const { return planes_; }
  /// Number of the plane to which the voxel of `p_W` belongs, or -1.
  int planeAt(const Eigen::Vector3d& p_W) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::vector<Plane> planes_;
};

}  // namespace cocalib
