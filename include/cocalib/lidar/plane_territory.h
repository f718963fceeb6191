#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "cocalib/geometry/plane.h"
#include "cocalib/lidar/voxel_index.h"

namespace cocalib {

/// Which planes pass near each voxel of space, and which of them may claim points there. Built once, asked millions of
/// times.
class PlaneTerritory {
 public:
  explicit PlaneTerritory(double edge_m) : edge_m_(edge_m), inverse_edge_(1.0 / edge_m) {}

  /// Notes that a plane's surface passes near this voxel: points there are only given away when they are clear of it.
  void addNear(const Voxel& voxel, int plane);
  /// Lets a plane claim points of this voxel; it must have been added as near.
  void allow(const Voxel& voxel, int plane);

  /// Calls visit(plane number) for every plane near the voxel.
  template <typename Visit>
  void forEachNear(const Voxel& voxel, const Visit& visit) const {
    const int number = index_.find(voxel);
    if (number < 0) return;
    const Cell& cell = cells_[static_cast<std::size_t>(number)];
    for (int i = 0; i < cell.count; ++i) visit(static_cast<int>(cell.plane[i]));
  }

  /// Number of the plane that claims the point `p` seen along the unit vector `ray`, or -1. A plane claims a point
  /// within gate_m if the ray meets it in a voxel allowed to it, and meets no other plane there that could claim the
  /// point too. All but the gate is judged where ray and plane meet, hence independent of the noise of the point's
  /// range.
  int claim(const Eigen::Vector3d& p, const Eigen::Vector3d& ray, const std::vector<Plane>& planes,
            double gate_m) const;

 private:
  static constexpr int kMaxPlanes = 8;  // near one voxel; where more meet nothing is certain
  struct Cell {
    std::array<std::int16_t, kMaxPlanes> plane{};
    std::uint8_t count = 0;
    std::uint8_t allowed = 0;  ///< bit i: plane[i] may claim points
    bool crowded = false;

    bool allows(int claimant) const;
  };

  double edge_m_, inverse_edge_;
  VoxelIndex index_;
  std::vector<Cell> cells_;
};

}  // namespace cocalib
