#include <Eigen/Eigenvalues>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <random>

#include "cocalib/lidar/board_patch.h"

namespace cocalib::plate {
namespace {

constexpr int kRefits = 3;

Plane awayFromLidar(Plane plane) {
  if (plane.offset_m < 0.0) plane = {-plane.normal, -plane.offset_m};
  return plane;
}

std::optional<Plane> planeThrough(const Eigen::Vector3d& a, const Eigen::Vector3d& b, const Eigen::Vector3d& c) {
  const Eigen::Vector3d cross = (b - a).cross(c - a);
  const double length = cross.norm();
  // A triangle thinner than this has no normal worth testing at centimetre noise.
  if (length < 0.2 * (b - a).norm() * (c - a).norm() || length < 1e-4) return std::nullopt;
  const Eigen::Vector3d normal = cross / length;
  return awayFromLidar({normal, normal.dot(a)});
}

std::vector<int> within(const Sweep& sweep, const std::vector<int>& indices, const Plane& plane, double gate_m) {
  std::vector<int> found;
  for (const int i : indices) {
    if (std::abs(plane.distance(sweep.point(i))) < gate_m) found.push_back(i);
  }
  return found;
}

}  // namespace

PlaneFrame::PlaneFrame(const Plane& plane_L, const Eigen::Vector3d& near_L, const Eigen::Vector3d& along)
    : plane(plane_L), origin_L(near_L - plane_L.distance(near_L) * plane_L.normal) {
  const auto flattened = [this](const Eigen::Vector3d& d) {
    return Eigen::Vector3d(d - plane.normal.dot(d) * plane.normal);
  };
  u = flattened(along);
  if (u.norm() < 0.1) {
    u = flattened(std::abs(plane.normal.z()) < 0.9 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX());
  }
  u.normalize();
  v = plane.normal.cross(u);
}

std::optional<Plane> fitPlane(const Sweep& sweep, const std::vector<int>& indices) {
  if (indices.size() < 3) return std::nullopt;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const int i : indices) mean += sweep.point(i);
  mean /= static_cast<double>(indices.size());
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const int i : indices) {
    const Eigen::Vector3d d = sweep.point(i) - mean;
    scatter += d * d.transpose();
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(scatter);
  // Points along one ring leave the tilt to the noise.
  const double width2 = eigen.eigenvalues()[1] / static_cast<double>(indices.size());
  const double noise2 = sweep.range_noise_m * sweep.range_noise_m;
  if (width2 < std::max(1e-8, 2.0 * noise2)) return std::nullopt;
  const Eigen::Vector3d normal = eigen.eigenvectors().col(0);
  return awayFromLidar({normal, normal.dot(mean)});
}

std::optional<Plane> findPlane(const Sweep& sweep, const std::vector<int>& indices, const Eigen::Vector3d& towards,
                               double max_angle_rad, int iterations, std::vector<int>* supporters) {
  const auto n = static_cast<std::uint32_t>(indices.size());
  if (n < 8) return std::nullopt;
  const double min_cosine = std::cos(std::min(max_angle_rad, 1.55));
  const double gate = 2.0 * sweep.range_noise_m + 0.005;  // tighter than the final gate: prefers the true tilt
  std::mt19937 random(1234);
  std::optional<Plane> best;
  std::size_t best_support = 0;
  for (int iteration = 0; iteration < iterations; ++iteration) {
    // Plain modulo: the standard leaves uniform_int_distribution's numbers to the library.
    const int a = indices[random() % n], b = indices[random() % n], c = indices[random() % n];
    const auto plane = planeThrough(sweep.point(a), sweep.point(b), sweep.point(c));
    if (!plane || plane->normal.dot(towards) < min_cosine) continue;
    const std::size_t support = within(sweep, indices, *plane, gate).size();
    if (support > best_support) {
      best_support = support;
      best = plane;
    }
  }
  for (int refit = 0; refit < kRefits && best; ++refit) {
    best = fitPlane(sweep, within(sweep, indices, *best, sweep.onGate()));
  }
  if (!best || best->normal.dot(towards) < min_cosine) return std::nullopt;
  *supporters = within(sweep, indices, *best, sweep.onGate());
  return best;
}

}  // namespace cocalib::plate
