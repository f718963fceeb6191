#include "cocalib/lidar/plane_growing.h"

#include <algorithm>
#include <cmath>
#include <numeric>

namespace cocalib {
namespace {

constexpr double kThicknessSigmas = 1.3;  // of a flat voxel; poses may be a little worse than said
constexpr double kMinWidth = 0.15;        // spread along the second axis / voxel edge: a single ring is a line
constexpr double kMinFlatness = 4.0;      // variance along the second axis / along the normal
// A voxel may hold one half of the noise of a plane on its face: its mean is then 0.8 sigma off the plane.
constexpr double kJoinSigmas = 1.2;
// Voxels beside a region in which the plane cuts off a corner hold a skewed part of its noise: flat perhaps, but
// tilted. What stays within this root mean square distance of the plane is the plane.
constexpr double kCoveredSigmas = 2.5;
constexpr double kMergeSigmas = 0.5;
constexpr double kRefitGrowth = 1.05;

/// What one voxel says by itself.
struct FlatVoxel {
  bool flat = false;
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double normal_sigma = 0.0;  ///< [rad], about the less certain axis
  double score = 0.0;
};

FlatVoxel judge(const PointMoments& moments, const PlaneMap::Params& params) {
  FlatVoxel voxel;
  const double n = moments.count;
  if (n < params.min_voxel_points) return voxel;
  const PrincipalAxes principal = principalAxes(moments);
  const double sigma2 = params.sigma() * params.sigma();
  const double min_width_m = kMinWidth * params.voxel_m;
  voxel.flat =
      principal.variances[0] < kThicknessSigmas * kThicknessSigmas * sigma2 * (1.0 + 4.0 * std::sqrt(2.0 / n)) &&
      principal.variances[1] > min_width_m * min_width_m &&
      principal.variances[1] > kMinFlatness * principal.variances[0];
  voxel.normal = principal.axes.col(0);
  voxel.normal_sigma = params.sigma() / std::sqrt(n * std::max(principal.variances[1], 1e-12));
  voxel.score = n * principal.variances[1] / (principal.variances[0] + 0.25 * sigma2);
  return voxel;
}

/// Standard deviation of a fitted plane's distance at `p` [m].
double planeSigmaAt(const PlaneRegion& region, const Eigen::Vector3d& p, double sigma_m) {
  const PrincipalAxes principal = principalAxes(region.moments);
  const Eigen::Vector3d arm = principal.axes.transpose() * (p - region.moments.mean);
  const double leverage = 1.0 + arm[1] * arm[1] / principal.variances[1] + arm[2] * arm[2] / principal.variances[2];
  return sigma_m * std::sqrt(leverage / region.moments.count);
}

class Grower {
 public:
  Grower(const MomentVoxels& voxels, const PlaneMap::Params& params) : voxels_(voxels), params_(params) {
    judged_.reserve(static_cast<std::size_t>(voxels.size()));
    for (int i = 0; i < voxels.size(); ++i) judged_.push_back(judge(voxels[i].moments, params));
    taken_.assign(judged_.size(), false);
  }

  std::vector<PlaneRegion> run() {
    std::vector<int> seeds;
    for (int i = 0; i < voxels_.size(); ++i) {
      if (judged_[i].flat) seeds.push_back(i);
    }
    std::stable_sort(seeds.begin(), seeds.end(), [&](int a, int b) { return judged_[a].score > judged_[b].score; });
    std::vector<PlaneRegion> regions;
    for (const int seed : seeds) {
      if (!taken_[seed]) regions.push_back(grow(seed));
    }
    return regions;
  }

 private:
  PlaneRegion grow(int seed) {
    PlaneRegion region;
    double fitted_count = 0.0;
    const auto take = [&](int number) {
      taken_[number] = true;
      region.members.push_back(number);
      region.moments.join(voxels_[number].moments);
      if (region.moments.count < kRefitGrowth * fitted_count) return;
      region.plane = fitPlane(region.moments);
      fitted_count = region.moments.count;
    };
    take(seed);
    for (std::size_t next = 0; next < region.members.size(); ++next) {
      forEachNeighbour(region.members[next], [&](int number) {
        if (judged_[number].flat && fits(region.plane, number)) take(number);
      });
    }
    region.plane = fitPlane(region.moments);
    cover(&region);
    return region;
  }

  template <typename Visit>
  void forEachNeighbour(int number, const Visit& visit) const {
    const Voxel centre = voxels_[number].voxel;
    for (int i = 0; i < 27; ++i) {
      const int neighbour = voxels_.find(centre + Voxel(i % 3 - 1, i / 3 % 3 - 1, i / 9 - 1));
      if (neighbour >= 0 && !taken_[neighbour]) visit(neighbour);
    }
  }

  /// Takes the flat voxels beside the region that hold nothing but a part of its noise, without letting them shape the
  /// fit.
  void cover(PlaneRegion* region) {
    const std::size_t count = region->members.size();
    for (std::size_t i = 0; i < count; ++i) {
      forEachNeighbour(region->members[i], [&](int number) {
        if (!judged_[number].flat) return;
        const PointMoments& moments = voxels_[number].moments;
        const double mean = region->plane.distance(moments.mean);
        const double square = mean * mean + moments.varianceAlong(region->plane.normal);
        if (square > kCoveredSigmas * kCoveredSigmas * params_.sigma() * params_.sigma()) return;
        taken_[number] = true;
        region->members.push_back(number);
      });
    }
  }

  bool fits(const Plane& plane, int number) const {
    const FlatVoxel& voxel = judged_[number];
    const double angle = std::acos(std::min(1.0, std::abs(voxel.normal.dot(plane.normal))));
    if (angle > params_.max_normal_angle_rad + 2.0 * voxel.normal_sigma) return false;
    const PointMoments& moments = voxels_[number].moments;
    const double tolerance = params_.sigma() * (kJoinSigmas + 3.0 / std::sqrt(moments.count));
    return std::abs(plane.distance(moments.mean)) < tolerance;
  }

  const MomentVoxels& voxels_;
  const PlaneMap::Params& params_;
  std::vector<FlatVoxel> judged_;
  std::vector<char> taken_;
};

bool coplanar(const PlaneRegion& a, const PlaneRegion& b, const PlaneMap::Params& params) {
  if (std::abs(a.plane.normal.dot(b.plane.normal)) < std::cos(params.max_normal_angle_rad)) return false;
  const double sigma_m = params.sigma();
  const auto near = [&](const PlaneRegion& plane, const Eigen::Vector3d& p) {
    return std::abs(plane.plane.distance(p)) < kMergeSigmas * sigma_m + 3.0 * planeSigmaAt(plane, p, sigma_m);
  };
  return near(a, b.moments.mean) && near(b, a.moments.mean);
}

/// Joins coplanar regions into the larger one until none is left that fits. @param regions most supported first
void mergeCoplanar(const PlaneMap::Params& params, std::vector<PlaneRegion>* regions) {
  for (std::size_t i = 0; i < regions->size(); ++i) {
    PlaneRegion& big = (*regions)[i];
    for (bool changed = true; changed;) {
      changed = false;
      for (std::size_t j = i + 1; j < regions->size();) {
        PlaneRegion& small = (*regions)[j];
        if (!coplanar(big, small, params)) {
          ++j;
          continue;
        }
        big.members.insert(big.members.end(), small.members.begin(), small.members.end());
        big.moments.join(small.moments);
        big.plane = fitPlane(big.moments);
        regions->erase(regions->begin() + static_cast<std::ptrdiff_t>(j));
        changed = true;
      }
    }
  }
}

/// Area covered by the voxels of a region: columns along the normal's main axis, projected back onto the plane [m^2].
double areaOf(const PlaneRegion& region, const MomentVoxels& voxels) {
  int axis = 0;
  const double cosine = region.plane.normal.cwiseAbs().maxCoeff(&axis);
  VoxelIndex columns;
  for (const int number : region.members) {
    Voxel column = voxels[number].voxel;
    column[axis] = 0;
    columns.findOrInsert(column);
  }
  return columns.size() * voxels.edge() * voxels.edge() / cosine;
}

}  // namespace

Plane fitPlane(const PointMoments& moments) {
  Plane plane;
  plane.normal = principalAxes(moments).axes.col(0);
  plane.offset_m = plane.normal.dot(moments.mean);
  plane.anchor = moments.mean;
  return pointedOutward(plane);
}

std::vector<PlaneRegion> growPlanes(const MomentVoxels& voxels, const PlaneMap::Params& params) {
  std::vector<PlaneRegion> regions = Grower(voxels, params).run();
  const auto more = [](const PlaneRegion& a, const PlaneRegion& b) { return a.moments.count > b.moments.count; };
  std::stable_sort(regions.begin(), regions.end(), more);
  mergeCoplanar(params, &regions);
  const auto small = [&](const PlaneRegion& region) { return areaOf(region, voxels) < params.min_plane_area_m2; };
  regions.erase(std::remove_if(regions.begin(), regions.end(), small), regions.end());
  std::stable_sort(regions.begin(), regions.end(), more);
  return regions;
}

}  // namespace cocalib
