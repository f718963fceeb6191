#include "cocalib/lidar/planar_voxel_map.h"

#include <cmath>

namespace cocalib {
namespace {

constexpr double kMinPoints = 10.0;
constexpr double kRefitGrowth = 1.2;
// Spread of the points along their second axis, as a part of the voxel's edge: a single ring of a spinning lidar is a
// line and determines no normal.
constexpr double kMinWidth = 0.1;
// A bound on memory: 3 levels of this many voxels of about 250 bytes.
constexpr std::size_t kMaxVoxels = 300000;

}  // namespace

PlanarVoxelMap::PlanarVoxelMap(double voxel_m, double thickness_m) : thickness_m_(thickness_m), levels_(kLevels) {
  double edge_m = voxel_m;
  for (Level& level : levels_) {
    level.inverse_edge = 1.0 / edge_m;
    edge_m *= 2.0;
  }
}

void PlanarVoxelMap::add(const Eigen::Vector3d& p) {
  for (Level& level : levels_) {
    if (!voxelInRange(p, level.inverse_edge)) continue;
    const Voxel voxel = voxelOf(p, level.inverse_edge);
    const bool full = level.voxels.size() >= kMaxVoxels;
    const int number = full ? level.index.find(voxel) : level.index.findOrInsert(voxel);
    if (number < 0) continue;
    if (number == static_cast<int>(level.voxels.size())) level.voxels.emplace_back();
    VoxelData& data = level.voxels[number];
    data.moments.add(p);
    if (data.queued) continue;
    data.queued = true;
    level.queue.push_back(number);
  }
}

void PlanarVoxelMap::refresh() {
  for (Level& level : levels_) {
    for (const int number : level.queue) {
      VoxelData& data = level.voxels[number];
      data.queued = false;
      if (data.moments.count >= kMinPoints && data.moments.count >= kRefitGrowth * data.fitted_count) fit(level, &data);
    }
    level.queue.clear();
  }
}

void PlanarVoxelMap::fit(const Level& level, VoxelData* voxel) const {
  const PrincipalAxes principal = principalAxes(voxel->moments);
  const double min_width_m = kMinWidth / level.inverse_edge;
  voxel->fitted_count = voxel->moments.count;
  voxel->is_plane =
      principal.variances[0] < thickness_m_ * thickness_m_ && principal.variances[1] > min_width_m * min_width_m;
  if (!voxel->is_plane) return;
  LocalPlane& plane = voxel->plane;
  plane.centre = voxel->moments.mean;
  plane.normal = principal.axes.col(0);
  plane.axis_a = principal.axes.col(2) / std::sqrt(principal.variances[2]);
  plane.axis_b = principal.axes.col(1) / std::sqrt(principal.variances[1]);
  plane.inverse_count = 1.0 / voxel->moments.count;
}

void PlanarVoxelMap::clear() {
  for (Level& level : levels_) {
    level.index.clear();
    level.voxels.clear();
    level.queue.clear();
  }
}

const PlanarVoxelMap::LocalPlane* PlanarVoxelMap::nearestPlane(const Eigen::Vector3d& p, double gate_m,
                                                               int first_level) const {
  for (int i = first_level; i < kLevels; ++i) {
    if (!voxelInRange(p, levels_[i].inverse_edge)) return nullptr;
    if (const LocalPlane* plane = nearestInLevel(levels_[i], p, gate_m)) return plane;
  }
  return nullptr;
}

const PlanarVoxelMap::LocalPlane* PlanarVoxelMap::nearestInLevel(const Level& level, const Eigen::Vector3d& p,
                                                                 double gate_m) const {
  const LocalPlane* best = nullptr;
  double best_distance = gate_m;
  const auto consider = [&](const Voxel& voxel) {
    const int number = level.index.find(voxel);
    if (number < 0 || !level.voxels[number].is_plane) return;
    const double distance = std::abs(level.voxels[number].plane.distance(p));
    if (distance >= best_distance) return;
    best_distance = distance;
    best = &level.voxels[number].plane;
  };
  const Voxel own = voxelOf(p, level.inverse_edge);
  consider(own);
  const Eigen::Vector3d inside = p * level.inverse_edge - own.cast<double>();  // 0..1 in the voxel
  const double reach = gate_m * level.inverse_edge;
  for (int axis = 0; axis < 3; ++axis) {
    if (inside[axis] < reach) consider(own - Voxel::Unit(axis));
    if (inside[axis] > 1.0 - reach) consider(own + Voxel::Unit(axis));
  }
  return best;
}

}  // namespace cocalib
