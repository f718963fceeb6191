#include "cocalib/lidar/plane_map.h"

#include <algorithm>
#include <cmath>
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

void PlaneMap::extract() {
  const Params& params = impl_->params;
  std::vector<PlaneRegion> regions = growPlanes(impl_->voxels, params);
  const std::size_t kept = static_cast<std::size_t>(kGuardFactor) * static_cast<std::size_t>(params.max_planes);
  if (regions.size() > kept) regions.resize(kept);
  std::vector<RefinedPlane> refined = refinePlanes(impl_->voxels, regions, params);
  std::stable_sort(refined.begin(), refined.end(),
                   [](const RefinedPlane& a, const RefinedPlane& b) { return a.support > b.support; });

  planes_.clear();
  impl_->planes.clear();
  impl_->territory = PlaneTerritory(params.voxel_m);
  for (const RefinedPlane& plane : refined) {
    const int number = static_cast<int>(impl_->planes.size());
    impl_->planes.push_back(plane.plane);
    for (const Voxel& voxel : plane.surroundings) impl_->territory.addNear(voxel, number);
    if (number >= params.max_planes || plane.support <= 0.0) continue;
    planes_.push_back(plane.plane);
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
