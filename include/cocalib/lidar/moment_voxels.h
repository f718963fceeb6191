#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "cocalib/geometry/plane.h"
#include "cocalib/lidar/point_moments.h"
#include "cocalib/lidar/voxel_index.h"

namespace cocalib {

/// Points of space gathered as moments in voxels of one size, numbered in the order in which they were first hit.
class MomentVoxels {
 public:
  struct Entry {
    Voxel voxel;
    PointMoments moments;
  };

  explicit MomentVoxels(double edge_m) : edge_m_(edge_m), inverse_edge_(1.0 / edge_m) {}

  /// Points that are not finite or out of range are ignored.
  void add(const Eigen::Vector3d& p) {
    if (!voxelInRange(p, inverse_edge_)) return;
    const Voxel voxel = voxelOf(p, inverse_edge_);
    const int number = index_.findOrInsert(voxel);
    if (number == size()) entries_.push_back({voxel, PointMoments()});
    entries_[static_cast<std::size_t>(number)].moments.add(p);
  }

  void clear() {
    index_.clear();
    entries_.clear();
  }

  int size() const { return static_cast<int>(entries_.size()); }
  double edge() const { return edge_m_; }
  double inverseEdge() const { return inverse_edge_; }
  const Entry& operator[](int number) const { return entries_[static_cast<std::size_t>(number)]; }
  int find(const Voxel& voxel) const { return index_.find(voxel); }

 private:
  double edge_m_, inverse_edge_;
  VoxelIndex index_;
  std::vector<Entry> entries_;
};

/// Middle of a voxel [m].
inline Eigen::Vector3d voxelCentre(const Voxel& voxel, double edge_m) {
  return edge_m * (voxel.cast<double>().array() + 0.5);
}

/// Whether a plane passes through a voxel grown by `margin_m` on all sides along the plane's normal.
inline bool planeMeetsVoxel(const Plane& plane, const Voxel& voxel, double edge_m, double margin_m) {
  const double reach = 0.5 * edge_m * plane.normal.lpNorm<1>() + margin_m;
  return std::abs(plane.distance(voxelCentre(voxel, edge_m))) < reach;
}

/// The same plane with its normal pointing away from the origin.
inline Plane pointedOutward(const Plane& plane) {
  return plane.offset_m < 0.0 ? Plane{-plane.normal, -plane.offset_m, plane.anchor} : plane;
}

/// Plane of least squared distances to points, anchored in their mean; its normal points away from the origin.
/// @pre moments.count > 0
Plane fitPlane(const PointMoments& moments);

}  // namespace cocalib
