#include "cocalib/lidar/plane_map.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

#include "cocalib/lidar/moment_voxels.h"
#include "cocalib/lidar/plane_growing.h"
#include "cocalib/lidar/plane_refinement.h"
#include "cocalib/lidar/plane_territory.h"

namespace cocalib {
namespace {

// Planes beyond the largest ones are kept to guard their surroundings, up to this many times Params::max_planes.
constexpr int kGuardFactor = 8;

// How far from a landmark the points of a plane that continues it may lie: what poses err by, in sigmas of a point.
constexpr double kContinueSigmas = 0.5;

/// Distance of a plane's points from a landmark, at worst over their spread [m]; infinite if they are not nearly
/// parallel.
double distanceFrom(const Plane& landmark, const RefinedPlane& plane, double max_angle_rad) {
  if (std::abs(landmark.normal.dot(plane.plane.normal)) < std::cos(max_angle_rad)) {
    return std::numeric_limits<double>::infinity();
  }
  const PrincipalAxes principal = principalAxes(plane.support);
  double worst = std::abs(landmark.distance(plane.support.mean));
  for (int axis = 1; axis < 3; ++axis) {
    const Eigen::Vector3d arm = std::sqrt(principal.variances[axis]) * principal.axes.col(axis);
    worst = std::max({worst, std::abs(landmark.distance(plane.support.mean + arm)),
                      std::abs(landmark.distance(plane.support.mean - arm))});
  }
  return worst;
}

/// Number of each plane, -1: it only guards its surroundings. @param refined most supported first
std::vector<int> numberPlanes(const std::vector<RefinedPlane>& refined,
                              const std::vector<std::optional<Plane>>& landmarks, const PlaneMap::Params& params) {
  std::vector<int> numbers(refined.size(), -1);
  std::vector<bool> taken(landmarks.size(), false);
  for (std::size_t i = 0; i < refined.size() && refined[i].support.count > 0.0; ++i) {
    double nearest = kContinueSigmas * params.sigma();
    for (std::size_t k = 0; k < landmarks.size(); ++k) {
      if (!landmarks[k] || taken[k]) continue;
      const double distance = distanceFrom(*landmarks[k], refined[i], params.max_normal_angle_rad);
      if (distance >= nearest) continue;
      nearest = distance;
      numbers[i] = static_cast<int>(k);
    }
    if (numbers[i] >= 0) taken[static_cast<std::size_t>(numbers[i])] = true;
  }
  int next = 0;
  const auto isFree = [&](int k) {
    return k >= static_cast<int>(landmarks.size()) || !landmarks[static_cast<std::size_t>(k)];
  };
  for (std::size_t i = 0; i < refined.size() && refined[i].support.count > 0.0; ++i) {
    if (numbers[i] >= 0) continue;
    while (!isFree(next)) ++next;
    if (next >= params.max_planes) break;
    numbers[i] = next++;
  }
  return numbers;
}

void require(bool condition, const char* what) {
  if (!condition) throw std::invalid_argument(std::string("PlaneMap: ") + what);
}

}  // namespace

double PlaneMap::Params::sigma() const { return std::hypot(point_sigma_m, deskew_sigma_m); }

void PlaneMap::Params::validate() const {
  require(voxel_m > 0.0, "voxel_m must be positive");
  require(point_sigma_m > 0.0 && deskew_sigma_m >= 0.0, "point_sigma_m must be positive, deskew_sigma_m not negative");
  require(sigma() < voxel_m, "the noise must be smaller than voxel_m");
  require(min_voxel_points >= 3, "min_voxel_points must be at least 3");
  require(max_normal_angle_rad > 0.0 && max_normal_angle_rad < 1.0, "max_normal_angle_rad must lie in 0..1");
  require(max_planes > 0 && max_planes <= 1000, "max_planes must lie in 1..1000");
  require(gate_sigmas > 0.0, "gate_sigmas must be positive");
}

struct PlaneMap::Impl {
  explicit Impl(const Params& p) : params(p), voxels(p.voxel_m), territory(p.voxel_m) {}

  Params params;
  MomentVoxels voxels;
  PlaneTerritory territory;
  std::vector<Plane> planes;  ///< the public ones, then those that only guard their surroundings
};

PlaneMap::PlaneMap(const Params& params) {
  params.validate();
  impl_ = std::make_unique<Impl>(params);
}

PlaneMap::~PlaneMap() = default;

void PlaneMap::addPoint(const Eigen::Vector3d& p_W) { impl_->voxels.add(p_W); }

void PlaneMap::extract(const std::vector<std::optional<Plane>>& landmarks) {
  const Params& params = impl_->params;
  std::vector<PlaneRegion> regions = growPlanes(impl_->voxels, params);
  const std::size_t kept = static_cast<std::size_t>(kGuardFactor) * static_cast<std::size_t>(params.max_planes);
  if (regions.size() > kept) regions.resize(kept);
  std::vector<RefinedPlane> refined = refinePlanes(impl_->voxels, regions, params);
  std::stable_sort(refined.begin(), refined.end(),
                   [](const RefinedPlane& a, const RefinedPlane& b) { return a.support.count > b.support.count; });

  const std::vector<int> numbers = numberPlanes(refined, landmarks, params);
  std::size_t count = landmarks.size();
  for (const int number : numbers) count = std::max(count, static_cast<std::size_t>(number + 1));
  planes_.assign(count, Plane());
  for (std::size_t i = 0; i < landmarks.size(); ++i) {
    if (landmarks[i]) planes_[i] = *landmarks[i];
  }
  // The territory knows the planes as they lie in these points; guards come after all numbers.
  impl_->planes = planes_;
  impl_->territory = PlaneTerritory(params.voxel_m);
  for (std::size_t i = 0; i < refined.size(); ++i) {
    const RefinedPlane& plane = refined[i];
    const bool numbered = numbers[i] >= 0;
    const int number = numbered ? numbers[i] : static_cast<int>(impl_->planes.size());
    if (!numbered) impl_->planes.emplace_back();
    const auto n = static_cast<std::size_t>(number);
    impl_->planes[n] = plane.plane;
    for (const Voxel& voxel : plane.surroundings) impl_->territory.addNear(voxel, number);
    if (!numbered) continue;
    if (n >= landmarks.size() || !landmarks[n]) planes_[n] = plane.plane;
    for (const Voxel& voxel : plane.pure) impl_->territory.allow(voxel, number);
  }
}

void PlaneMap::clear() {
  *impl_ = Impl(impl_->params);
  planes_.clear();
}

int PlaneMap::planeAt(const Eigen::Vector3d& p_W, const Eigen::Vector3d& ray_W) const {
  return impl_->territory.claim(p_W, ray_W, impl_->planes, impl_->params.gate_sigmas * impl_->params.sigma());
}

}  // namespace cocalib
