#include "cocalib/ros/plane_patches.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <map>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

constexpr std::size_t kLeastPoints = 50;
constexpr double kThicknessM = 0.01;

/// Fits one patch: normal and axes from the scatter of the points, extent from their spread along the axes.
PlanePatch fitPatch(int number, const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& p : points) mean += p;
  mean /= static_cast<double>(points.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Eigen::Vector3d& p : points) scatter += (p - mean) * (p - mean).transpose();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  Eigen::Matrix3d R;  // longest, middle, normal
  R << solver.eigenvectors().col(2), solver.eigenvectors().col(1), solver.eigenvectors().col(0);
  if (R.determinant() < 0.0) R.col(1) = -R.col(1);
  Eigen::Vector2d low = Eigen::Vector2d::Zero(), high = low;
  for (const Eigen::Vector3d& p : points) {
    const Eigen::Vector2d q = (R.transpose() * (p - mean)).head<2>();
    low = low.cwiseMin(q);
    high = high.cwiseMax(q);
  }
  PlanePatch patch;
  patch.number = number;
  patch.plane_W.normal = R.col(2);
  patch.plane_W.offset_m = R.col(2).dot(mean);
  const Eigen::Vector2d middle = 0.5 * (low + high);
  patch.T_W_P = {Eigen::Quaterniond(R), mean + R.leftCols<2>() * middle};
  patch.length_m = high.x() - low.x();
  patch.width_m = high.y() - low.y();
  patch.points = static_cast<int>(points.size());
  return patch;
}

/// A colour for each number that differs from those of the numbers next to it.
std_msgs::ColorRGBA colourOf(int number) {
  const double hue = std::fmod(0.618034 * number, 1.0) * 6.0;
  const auto part = [hue](double shift) {
    return static_cast<float>(std::clamp(std::abs(std::fmod(hue + shift, 6.0) - 3.0) - 1.0, 0.0, 1.0));
  };
  std_msgs::ColorRGBA colour;
  colour.r = part(0.0);
  colour.g = part(4.0);
  colour.b = part(2.0);
  colour.a = 0.25F;
  return colour;
}

}  // namespace

std::vector<PlanePatch> fitPatches(const DeskewedCloud& cloud) {
  std::map<int, std::vector<Eigen::Vector3d>> points;
  for (std::size_t i = 0; i < std::min(cloud.points_W.size(), cloud.plane.size()); ++i) {
    if (cloud.plane[i] >= 0 && cloud.points_W[i].allFinite()) {
      points[cloud.plane[i]].push_back(cloud.points_W[i].cast<double>());
    }
  }
  std::vector<PlanePatch> patches;
  for (const auto& [number, on_plane] : points) {
    if (on_plane.size() >= kLeastPoints) patches.push_back(fitPatch(number, on_plane));
  }
  return patches;
}

std::vector<float> distancesToPatches(const DeskewedCloud& cloud, const std::vector<PlanePatch>& patches) {
  std::map<int, const Plane*> plane_of;
  for (const PlanePatch& patch : patches) plane_of[patch.number] = &patch.plane_W;
  std::vector<float> distances(cloud.points_W.size(), -1.0F);
  for (std::size_t i = 0; i < std::min(cloud.points_W.size(), cloud.plane.size()); ++i) {
    const auto plane = plane_of.find(cloud.plane[i]);
    if (plane == plane_of.end()) continue;
    distances[i] = static_cast<float>(std::abs(plane->second->distance(cloud.points_W[i].cast<double>())));
  }
  return distances;
}

visualization_msgs::MarkerArray toPatchMarkers(const std::vector<PlanePatch>& patches, TimeNs stamp,
                                               const std::string& world_frame) {
  visualization_msgs::MarkerArray all;
  for (const PlanePatch& patch : patches) {
    visualization_msgs::Marker marker;
    marker.header.frame_id = world_frame;
    marker.header.stamp = toRosTime(stamp);
    marker.ns = "planes";
    marker.id = patch.number;
    marker.type = visualization_msgs::Marker::CUBE;
    marker.lifetime = ros::Duration(2.0);
    marker.pose = toPoseMsg(patch.T_W_P);
    marker.scale.x = std::max(patch.length_m, kThicknessM);
    marker.scale.y = std::max(patch.width_m, kThicknessM);
    marker.scale.z = kThicknessM;
    marker.color = colourOf(patch.number);
    all.markers.push_back(marker);
  }
  return all;
}

}  // namespace cocalib
