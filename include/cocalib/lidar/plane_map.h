#pragma once

#include <Eigen/Core>
#include <memory>
#include <optional>
#include <vector>

#include "cocalib/geometry/plane.h"

namespace cocalib {

/// Large planes of a scene and which points of space belong to each.
///
/// Points (world frame, deskewed) are gathered in voxels; voxels whose points are flat are joined with coplanar
/// neighbours by region growing, and coplanar regions across gaps too, so that one wall is one plane. The planes are
/// then fitted in columns of voxels that cross the whole noise of the plane: a wall on the face between two layers of
/// voxels is not cut in halves. Columns that hold anything else (an edge, a second plane, clutter) neither take part in
/// the fit nor answer planeAt(). New planes are numbered by size, most supported first; normals point away from the
/// origin.
/// Memory grows with the voxels touched, not with the points. Not thread-safe. Deterministic (results depend on the
/// points and their order only).
class PlaneMap {
 public:
  struct Params {
    double voxel_m = 0.4;
    double point_sigma_m = 0.03;   ///< noise of a point along the plane normal, 1 sigma
    double deskew_sigma_m = 0.02;  ///< what errors of pose and deskew add to it, 1 sigma; 0 when both are good
    int min_voxel_points = 12;
    double max_normal_angle_rad = 0.12;  ///< between a voxel and the plane that it joins
    double min_plane_area_m2 = 0.3;
    int max_planes = 60;
    double gate_sigmas = 4.5;  ///< distance to the plane within which planeAt() answers, and to others that it demands

    /// Of a point about its plane, all together, 1 sigma [m].
    double sigma() const;
    /// @throws std::invalid_argument naming the parameter
    void validate() const;
  };
  /// @throws std::invalid_argument
  explicit PlaneMap(const Params& params);
  ~PlaneMap();

  /// Points that are not finite are ignored.
  void addPoint(const Eigen::Vector3d& p_W);
  /// Finds the planes of all points added so far.
  /// @param landmarks  planes known from before, by number; an empty one is a number that is free. A plane that
  /// continues
  ///                   a landmark gets its number, new ones get free numbers, largest first, as long as no number
  ///                   reaches max_planes.
  void extract(const std::vector<std::optional<Plane>>& landmarks = {});
  /// Forgets points and planes.
  void clear();

  int planeCount() const { return static_cast<int>(planes_.size()); }
  /// Planes by number: landmarks as they were given, others as fitted. A free number that no plane got has a default
  /// one.
  const std::vector<Plane>& planes() const { return planes_; }
  /// Number of the plane that the point `p_W`, seen along the unit vector `ray_W`, belongs to, or -1: none near, or not
  /// certain which. Whether a point is taken does not depend on the noise of its range (up to gate_sigmas), so what is
  /// gathered with it is not biased by the choice.
  int planeAt(const Eigen::Vector3d& p_W, const Eigen::Vector3d& ray_W) const;

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
  std::vector<Plane> planes_;
};

}  // namespace cocalib
