#include "cocalib/lidar/plane_territory.h"

#include <algorithm>
#include <cmath>

namespace cocalib {

void PlaneTerritory::addNear(const Voxel& voxel, int plane) {
  const int number = index_.findOrInsert(voxel);
  if (number == static_cast<int>(cells_.size())) cells_.emplace_back();
  Cell& cell = cells_[static_cast<std::size_t>(number)];
  const auto* end = cell.plane.data() + cell.count;
  if (std::find(static_cast<const std::int16_t*>(cell.plane.data()), end, plane) != end) return;
  if (cell.count == kMaxPlanes) {
    cell.crowded = true;
    return;
  }
  cell.plane[cell.count++] = static_cast<std::int16_t>(plane);
}

void PlaneTerritory::allow(const Voxel& voxel, int plane) {
  const int number = index_.find(voxel);
  if (number < 0) return;
  Cell& cell = cells_[static_cast<std::size_t>(number)];
  for (int i = 0; i < cell.count; ++i) {
    if (cell.plane[i] == plane) cell.allowed = static_cast<std::uint8_t>(cell.allowed | 1U << i);
  }
}

bool PlaneTerritory::isAllowed(const Voxel& voxel, int plane) const {
  const int number = index_.find(voxel);
  if (number < 0) return false;
  const Cell& cell = cells_[static_cast<std::size_t>(number)];
  for (int i = 0; i < cell.count; ++i) {
    if (cell.plane[i] == plane) return (cell.allowed >> i & 1U) != 0 && !cell.crowded;
  }
  return false;
}

int PlaneTerritory::claim(const Eigen::Vector3d& p, const std::vector<Plane>& planes, double gate_m) const {
  if (!voxelInRange(p, inverse_edge_)) return -1;
  const Voxel own = voxelOf(p, inverse_edge_);
  const int number = index_.find(own);
  if (number < 0) return -1;
  const Cell& cell = cells_[static_cast<std::size_t>(number)];
  if (cell.crowded) return -1;
  for (int i = 0; i < cell.count; ++i) {
    const Plane& plane = planes[static_cast<std::size_t>(cell.plane[i])];
    const double distance = plane.distance(p);
    if (std::abs(distance) > gate_m) continue;
    const Voxel foot = voxelOf(p - distance * plane.normal, inverse_edge_);
    const bool allowed = foot == own ? (cell.allowed >> i & 1U) != 0 : isAllowed(foot, cell.plane[i]);
    if (!allowed) continue;
    bool clear = true;
    for (int j = 0; j < cell.count && clear; ++j) {
      if (j == i) continue;
      // A point that belongs to `other` lies within the gate of it, so its foot here is within gate (1 + |cosine|).
      const Plane& other = planes[static_cast<std::size_t>(cell.plane[j])];
      const double cosine = plane.normal.dot(other.normal);
      clear = std::abs(other.distance(p) - distance * cosine) > gate_m * (1.0 + std::abs(cosine));
    }
    if (clear) return cell.plane[i];
  }
  return -1;
}

}  // namespace cocalib
