#include "cocalib/lidar/plane_patch.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "cocalib/lidar/point_moments.h"

namespace cocalib {
namespace {

constexpr std::size_t kLeastPoints = 50;

PlanePatch fitPatch(int number, const std::vector<Eigen::Vector3d>& points) {
  PointMoments moments;
  for (const Eigen::Vector3d& p : points) moments.add(p);
  const PrincipalAxes principal = principalAxes(moments);
  Eigen::Matrix3d R;  // longest, middle, normal
  R << principal.axes.col(2), principal.axes.col(1), principal.axes.col(0);
  if (R.determinant() < 0.0) R.col(1) = -R.col(1);
  Eigen::Vector2d low = Eigen::Vector2d::Zero(), high = low;
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector2d q = (R.transpose() * (p - moments.mean)).head<2>();
    low = low.cwiseMin(q);
    high = high.cwiseMax(q);
  }
  PlanePatch patch;
  patch.number = number;
  patch.plane_W = {R.col(2), R.col(2).dot(moments.mean)};
  patch.T_W_P = {Eigen::Quaterniond(R), moments.mean + R.leftCols<2>() * (0.5 * (low + high))};
  patch.length_m = high.x() - low.x();
  patch.width_m = high.y() - low.y();
  patch.points = static_cast<int>(points.size());
  return patch;
}

}  // namespace

std::vector<PlanePatch> fitPatches(const std::vector<Eigen::Vector3f>& points_W,
                                   const std::vector<std::int16_t>& plane_of) {
  std::map<int, std::vector<Eigen::Vector3d>> points;
  for (std::size_t i = 0; i < std::min(points_W.size(), plane_of.size()); ++i) {
    if (plane_of[i] >= 0 && points_W[i].allFinite()) points[plane_of[i]].push_back(points_W[i].cast<double>());
  }
  std::vector<PlanePatch> patches;
  for (const auto& [number, on_plane] : points) {
    if (on_plane.size() >= kLeastPoints) patches.push_back(fitPatch(number, on_plane));
  }
  return patches;
}

std::vector<float> distancesToPatches(const std::vector<Eigen::Vector3f>& points_W,
                                      const std::vector<std::int16_t>& plane_of,
                                      const std::vector<PlanePatch>& patches) {
  std::map<int, const Plane*> plane_by_number;
  for (const PlanePatch& patch : patches) plane_by_number[patch.number] = &patch.plane_W;
  std::vector<float> distances(points_W.size(), -1.0F);
  for (std::size_t i = 0; i < std::min(points_W.size(), plane_of.size()); ++i) {
    const auto plane = plane_by_number.find(plane_of[i]);
    if (plane == plane_by_number.end()) continue;
    distances[i] = static_cast<float>(std::abs(plane->second->distance(points_W[i].cast<double>())));
  }
  return distances;
}

}  // namespace cocalib
