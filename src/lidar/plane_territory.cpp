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

bool PlaneTerritory::Cell::allows(int claimant) const {
  if (crowded) return false;
  for (int i = 0; i < count; ++i) {
    if (plane[i] == claimant) return (allowed >> i & 1U) != 0;
  }
  return false;
}

int PlaneTerritory::claim(const Eigen::Vector3d& p, const Eigen::Vector3d& ray, const std::vector<Plane>& planes,
                          double gate_m) const {
  // Nearer to grazing than 3 degrees, where ray and plane meet is anybody's guess.
  constexpr double kMinCosine = 0.05;
  if (!voxelInRange(p, inverse_edge_)) return -1;
  const Voxel own = voxelOf(p, inverse_edge_);
  const int number = index_.find(own);
  if (number < 0) return -1;
  const Cell& near = cells_[static_cast<std::size_t>(number)];
  for (int i = 0; i < near.count; ++i) {
    const int claimant = near.plane[i];
    const Plane& plane = planes[static_cast<std::size_t>(claimant)];
    const double distance = plane.distance(p);
    const double cosine = plane.normal.dot(ray);
    if (std::abs(distance) > gate_m || std::abs(cosine) < kMinCosine) continue;
    const Eigen::Vector3d met = p - distance / cosine * ray;
    if (!voxelInRange(met, inverse_edge_)) continue;
    const Voxel there = voxelOf(met, inverse_edge_);
    const int met_number = there == own ? number : index_.find(there);
    if (met_number < 0) continue;
    const Cell* cell = &cells_[static_cast<std::size_t>(met_number)];
    if (!cell->allows(claimant)) continue;
    const bool clear = std::none_of(cell->plane.data(), cell->plane.data() + cell->count, [&](int j) {
      if (j == claimant) return false;
      // Ranges on both planes along this ray must differ by more than the noise of one and the gate of the other.
      const Plane& other = planes[static_cast<std::size_t>(j)];
      return std::abs(other.distance(met)) < gate_m * (0.5 + 2.0 * std::abs(other.normal.dot(ray)));
    });
    if (clear) return claimant;
  }
  return -1;
}

}  // namespace cocalib
