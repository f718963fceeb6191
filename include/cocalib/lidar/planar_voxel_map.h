#pragma once

#include <Eigen/Core>
#include <vector>

#include "cocalib/lidar/point_moments.h"
#include "cocalib/lidar/voxel_index.h"

namespace cocalib {

/// A map of points as local planes in voxels of three sizes (1, 2 and 4 times the finest). It takes points at any time
/// and keeps only their moments: memory grows with the space seen, not with the points. Not thread-safe. Deterministic.
class PlanarVoxelMap {
 public:
  static constexpr int kLevels = 3;

  /// Local plane of a voxel with what is known of its accuracy.
  struct LocalPlane {
    Eigen::Vector3d centre = Eigen::Vector3d::Zero();   ///< [m]
    Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();  ///< unit
    Eigen::Vector3d axis_a =
        Eigen::Vector3d::Zero();  ///< longest spread in the plane, over its standard deviation [1/m]
    Eigen::Vector3d axis_b = Eigen::Vector3d::Zero();  ///< the other spread in the plane, likewise [1/m]
    double inverse_count = 0.0;                        ///< 1 / points that determine the plane

    double distance(const Eigen::Vector3d& p) const { return normal.dot(p - centre); }
    /// Variance of distance(p) that comes from the plane's own points, in units of one point's variance.
    double leverage(const Eigen::Vector3d& p) const {
      const Eigen::Vector3d arm = p - centre;
      const double a = axis_a.dot(arm);
      const double b = axis_b.dot(arm);
      return inverse_count * (1.0 + a * a + b * b);
    }
  };

  /// @param voxel_m edge of the finest voxel [m]; @param thickness_m largest standard deviation of points about their
  /// plane [m]: what is thicker is not a plane
  PlanarVoxelMap(double voxel_m, double thickness_m);

  /// Adds points; the local planes follow with the next call of refresh().
  void add(const Eigen::Vector3d& p);
  /// Fits anew the planes whose points have grown by a fifth since their last fit.
  void refresh();
  void clear();
  bool empty() const { return levels_.front().voxels.empty(); }
  double finestEdge() const { return 1.0 / levels_.front().inverse_edge; }  ///< [m]

  /// The plane nearest to `p` within `gate_m`, in the finest level from `first_level` upward that has one; null if
  /// none. Looks into the voxel of `p` and those neighbours that are nearer than the gate.
  const LocalPlane* nearestPlane(const Eigen::Vector3d& p, double gate_m, int first_level) const;

 private:
  struct VoxelData {
    PointMoments moments;
    double fitted_count = 0.0;
    bool queued = false;
    bool is_plane = false;
    LocalPlane plane;
  };
  struct Level {
    double inverse_edge = 1.0;
    VoxelIndex index;
    std::vector<VoxelData> voxels;
    std::vector<int> queue;  ///< voxels with new points since the last refresh
  };

  void fit(const Level& level, VoxelData* voxel) const;
  const LocalPlane* nearestInLevel(const Level& level, const Eigen::Vector3d& p, double gate_m) const;

  double thickness_m_;
  std::vector<Level> levels_;
};

}  // namespace cocalib
