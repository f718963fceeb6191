#include "cocalib/lidar/plane_refinement.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace cocalib {
namespace {

constexpr int kRounds = 4;
// Half height of a column in sigmas: the noise beyond it would move the mean by 0.4 % of a sigma.
constexpr double kColumnSigmas = 3.0;
// Distance that a column's patch of the plane keeps from other planes, in sigmas.
constexpr double kClearanceSigmas = 2.5;
// A column's mean may lie this far from the plane (deskew errors bend walls), plus four times its own uncertainty.
constexpr double kMeanSigmas = 0.6;
// In the first round more is allowed: a region grown on one side of the face between two layers of voxels has but one
// half of the noise and lies 0.8 sigma off.
constexpr double kFirstMeanSigmas = 1.2;
constexpr double kTestSigmas = 4.0;
// What a column's variance may exceed that of the noise by, as a part of it: the noise itself is known no better.
constexpr double kThicknessSlack = 0.2;
// The surface goes on beyond a column's face if the neighbour holds this part of the column's points: noise alone
// carries about 2 % over a face at which the surface ends.
constexpr double kNeighbourShare = 0.05;
// A fit whose normal is less certain than this tells nothing of a plane; its neighbours are still guarded [rad].
constexpr double kMaxNormalSigma = 0.01;
// Steps in which a plane's surface is continued beyond its flat voxels: over an edge, where none is flat, and one
// farther.
constexpr int kContinuation = 2;

/// Coordinate in which a plane's normal is largest.
int mainAxis(const Plane& plane) {
  int axis = 0;
  plane.normal.cwiseAbs().maxCoeff(&axis);
  return axis;
}

/// Regression of the coordinate `axis` on the other two. The points were chosen by those two, and given those their
/// noise has no mean; given the coordinates in the plane it has, unless the plane is square to the axis.
Plane regress(const PointMoments& moments, int axis) {
  const int u = (axis + 1) % 3, v = (axis + 2) % 3;
  const Eigen::Matrix3d& S = moments.scatter;
  const double determinant = S(u, u) * S(v, v) - S(u, v) * S(u, v);
  Plane plane;
  plane.normal[axis] = 1.0;
  plane.normal[u] = (S(u, v) * S(axis, v) - S(v, v) * S(axis, u)) / determinant;
  plane.normal[v] = (S(u, v) * S(axis, u) - S(u, u) * S(axis, v)) / determinant;
  plane.normal.normalize();
  plane.offset_m = plane.normal.dot(moments.mean);
  plane.anchor = moments.mean;
  return pointedOutward(plane);
}

class Refiner {
 public:
  Refiner(const MomentVoxels& voxels, const std::vector<PlaneRegion>& regions, const PlaneMap::Params& params)
      : voxels_(voxels), params_(params), sigma_m_(params.sigma()), territory_(voxels.edge()) {
    for (const PlaneRegion& region : regions) {
      planes_.push_back({region.plane, PointMoments(), surroundingsOf(region), {}});
      columns_.push_back(columnsOf(region));
      const int number = static_cast<int>(planes_.size()) - 1;
      for (const Voxel& voxel : planes_.back().surroundings) territory_.addNear(voxel, number);
    }
  }

  std::vector<RefinedPlane> run() {
    for (int round = 0; round < kRounds; ++round) {
      const std::vector<Plane> before = currentPlanes();
      const double mean_sigmas = round == 0 ? kFirstMeanSigmas : kMeanSigmas;
      for (std::size_t i = 0; i < planes_.size(); ++i) fitToPureColumns(before, i, mean_sigmas);
    }
    return std::move(planes_);
  }

 private:
  /// Column of voxels along the plane's main axis: the coordinates across it, and 0 along it.
  using Column = Voxel;

  std::vector<Plane> currentPlanes() const {
    std::vector<Plane> planes;
    for (const RefinedPlane& refined : planes_) planes.push_back(refined.plane);
    return planes;
  }

  /// Voxels around the region's members that its plane passes, with the margin within which claims are judged.
  std::vector<Voxel> surroundingsOf(const PlaneRegion& region) const {
    const double margin_m = 2.0 * params_.gate_sigmas * sigma_m_;
    constexpr int kWidth = 2 * kContinuation + 1;
    VoxelIndex seen;
    std::vector<Voxel> found;
    for (const int member : region.members) {
      const Voxel centre = voxels_[member].voxel;
      for (int i = 0; i < kWidth * kWidth * kWidth; ++i) {
        const Voxel step(i % kWidth, i / kWidth % kWidth, i / (kWidth * kWidth));
        const Voxel voxel = centre + step - Voxel::Constant(kContinuation);
        if (!planeMeetsVoxel(region.plane, voxel, voxels_.edge(), margin_m)) continue;
        if (seen.findOrInsert(voxel) == static_cast<int>(found.size())) found.push_back(voxel);
      }
    }
    return found;
  }

  std::vector<Column> columnsOf(const PlaneRegion& region) const {
    const int axis = mainAxis(region.plane);
    VoxelIndex seen;
    std::vector<Column> columns;
    for (const int member : region.members) {
      Column column = voxels_[member].voxel;
      column[axis] = 0;
      if (seen.findOrInsert(column) == static_cast<int>(columns.size())) columns.push_back(column);
    }
    return columns;
  }

  /// The plane's points over the four corners of a column.
  std::array<Eigen::Vector3d, 4> patchOf(const Plane& plane, const Column& column) const {
    const int axis = mainAxis(plane), u = (axis + 1) % 3, v = (axis + 2) % 3;
    std::array<Eigen::Vector3d, 4> patch;
    for (int i = 0; i < 4; ++i) {
      Eigen::Vector3d& corner = patch[static_cast<std::size_t>(i)];
      corner[u] = voxels_.edge() * (column[u] + (i & 1));
      corner[v] = voxels_.edge() * (column[v] + (i >> 1));
      corner[axis] = (plane.offset_m - plane.normal[u] * corner[u] - plane.normal[v] * corner[v]) / plane.normal[axis];
    }
    return patch;
  }

  /// Voxels of a column that the plane's patch, grown by `sigmas` along the normal, passes.
  std::vector<Voxel> voxelsOf(const Plane& plane, const Column& column, double sigmas) const {
    const int axis = mainAxis(plane);
    double low = 1e300, high = -1e300;
    for (const Eigen::Vector3d& corner : patchOf(plane, column)) {
      low = std::min(low, corner[axis]);
      high = std::max(high, corner[axis]);
    }
    const double margin_m = sigmas * sigma_m_ / std::abs(plane.normal[axis]);
    std::vector<Voxel> found;
    const int first = static_cast<int>(std::floor((low - margin_m) * voxels_.inverseEdge()));
    const int last = static_cast<int>(std::floor((high + margin_m) * voxels_.inverseEdge()));
    for (int k = first; k <= last; ++k) {
      Voxel voxel = column;
      voxel[axis] = k;
      found.push_back(voxel);
    }
    return found;
  }

  PointMoments momentsOf(const std::vector<Voxel>& stack) const {
    PointMoments moments;
    for (const Voxel& voxel : stack) {
      const int number = voxels_.find(voxel);
      if (number >= 0) moments.join(voxels_[number].moments);
    }
    return moments;
  }

  bool hasOnly(const Plane& plane, const PointMoments& moments, double mean_sigmas) const {
    const double n = moments.count;
    if (n < params_.min_voxel_points) return false;
    const double mean = plane.distance(moments.mean);
    if (std::abs(mean) > sigma_m_ * (mean_sigmas + kTestSigmas / std::sqrt(n))) return false;
    // Thickness about the column's own mean: errors of the poses bend walls, but they do not thicken them here.
    const double tolerance = kThicknessSlack + kTestSigmas * std::sqrt(2.0 / n);
    return moments.varianceAlong(plane.normal) < sigma_m_ * sigma_m_ * (1.0 + tolerance);
  }

  /// Whether another plane cuts the column's patch of plane `self`, or passes too near: its distance is linear over the
  /// patch, so the corners tell.
  bool isCut(const std::vector<Plane>& planes, std::size_t self, const Column& column,
             const std::vector<Voxel>& stack) const {
    const std::array<Eigen::Vector3d, 4> patch = patchOf(planes[self], column);
    const double clearance_m = kClearanceSigmas * sigma_m_;
    bool cut = false;
    const auto check = [&](int other) {
      if (other == static_cast<int>(self)) return;
      double low = 1e300, high = -1e300;
      for (const Eigen::Vector3d& corner : patch) {
        const double distance = planes[static_cast<std::size_t>(other)].distance(corner);
        low = std::min(low, distance);
        high = std::max(high, distance);
      }
      cut = cut || (low < clearance_m && high > -clearance_m);
    };
    for (const Voxel& voxel : stack) territory_.forEachNear(voxel, check);
    return cut;
  }

  /// Whether the surface goes on beyond all four sides of the column. Noise acts along the ray and hence along the
  /// surface too, in step with its part along the normal; where a surface is seen up to its end that correlation turns
  /// the fit (by up to 12 variances / width^2: 4 mrad for a panel of 1 m), in a window cut out of it gains and losses
  /// cancel.
  bool isInterior(const Plane& plane, const Column& column, double count) const {
    const int axis = mainAxis(plane);
    for (int side = 0; side < 4; ++side) {
      const Column neighbour = column + (side % 2 == 0 ? 1 : -1) * Column::Unit((axis + 1 + side / 2) % 3);
      if (momentsOf(voxelsOf(plane, neighbour, kColumnSigmas)).count < kNeighbourShare * count) return false;
    }
    return true;
  }

  void fitToPureColumns(const std::vector<Plane>& planes, std::size_t self, double mean_sigmas) {
    const Plane& plane = planes[self];
    RefinedPlane& refined = planes_[self];
    refined.pure.clear();
    PointMoments all;
    for (const Column& column : columns_[self]) {
      const std::vector<Voxel> stack = voxelsOf(plane, column, kColumnSigmas);
      const PointMoments moments = momentsOf(stack);
      if (!hasOnly(plane, moments, mean_sigmas) || !isInterior(plane, column, moments.count)) continue;
      if (isCut(planes, self, column, stack)) continue;
      all.join(moments);
      const std::vector<Voxel> claimed = voxelsOf(plane, column, params_.gate_sigmas);
      refined.pure.insert(refined.pure.end(), claimed.begin(), claimed.end());
    }
    refined.support = PointMoments();
    if (all.count <= 0.0) return;
    const double width_m = std::sqrt(principalAxes(all).variances[1]);
    if (sigma_m_ > kMaxNormalSigma * width_m * std::sqrt(all.count)) return;
    refined.support = all;
    refined.plane = regress(all, mainAxis(plane));
  }

  const MomentVoxels& voxels_;
  const PlaneMap::Params& params_;
  double sigma_m_;
  PlaneTerritory territory_;
  std::vector<RefinedPlane> planes_;
  std::vector<std::vector<Column>> columns_;
};

}  // namespace

std::vector<RefinedPlane> refinePlanes(const MomentVoxels& voxels, const std::vector<PlaneRegion>& regions,
                                       const PlaneMap::Params& params) {
  return Refiner(voxels, regions, params).run();
}

}  // namespace cocalib
