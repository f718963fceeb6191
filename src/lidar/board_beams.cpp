#include <Eigen/Geometry>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <map>

#include "cocalib/lidar/board_patch.h"

namespace cocalib::plate {
namespace {

/// Pose of the sensor in L while it swept over the patch: the rigid motion from the raw to the deskewed points
/// (Kabsch). It is the identity for a rig at rest. Beams start there, not at the origin of L.
Pose sensorPose(const Sweep& sweep, const std::vector<int>& members) {
  if (members.size() < 3) return {};
  Eigen::Vector3d raw_mean = Eigen::Vector3d::Zero(), mean = Eigen::Vector3d::Zero();
  for (const int i : members) {
    raw_mean += sweep.raw(i).p.cast<double>();
    mean += sweep.point(i);
  }
  raw_mean /= static_cast<double>(members.size());
  mean /= static_cast<double>(members.size());
  Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();
  for (const int i : members) cross += (sweep.point(i) - mean) * (sweep.raw(i).p.cast<double>() - raw_mean).transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double handedness = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  const Eigen::Matrix3d R =
      svd.matrixU() * Eigen::Vector3d(1.0, 1.0, handedness).asDiagonal() * svd.matrixV().transpose();
  return {Eigen::Quaterniond(R).normalized(), mean - R * raw_mean};
}

Verdict judge(const Sweep& sweep, double behind_m) {
  if (std::abs(behind_m) < sweep.onGate()) return Verdict::kOn;
  if (behind_m < 0.0) return Verdict::kBlocked;
  return behind_m > sweep.offGate() ? Verdict::kOff : Verdict::kUnclear;
}

}  // namespace

std::vector<Row> beamsNear(const Sweep& sweep, const PlaneFrame& frame, const std::vector<int>& members,
                           double radius_m) {
  const Pose T_L_S = sensorPose(sweep, members);
  const double distance = -frame.plane.distance(T_L_S.t);  // of the sensor before the plane
  std::map<int, Row> rows;
  if (distance <= 0.0) return {};
  const Eigen::Vector3d middle_S = T_L_S.inverse() * frame.origin_L;
  const double middle_azimuth = std::atan2(middle_S.y(), middle_S.x());

  for (int i = 0; i < static_cast<int>(sweep.points_L.size()); ++i) {
    const Eigen::Vector3d ray = sweep.point(i) - T_L_S.t;
    const double approach = frame.plane.normal.dot(ray);
    if (approach <= 1e-3) continue;
    const Eigen::Vector2d hit = frame.coordinates(T_L_S.t + distance / approach * ray);
    if (hit.squaredNorm() > radius_m * radius_m) continue;
    const LidarPoint& raw = sweep.raw(i);
    const double azimuth = std::atan2(static_cast<double>(raw.p.y()), static_cast<double>(raw.p.x())) - middle_azimuth;
    Row& row = rows[raw.ring];
    row.ring = raw.ring;
    row.beams.push_back({i, std::remainder(azimuth, 2.0 * M_PI), hit, judge(sweep, approach - distance)});
  }
  std::vector<Row> sorted;
  for (auto& [ring, row] : rows) {
    std::stable_sort(row.beams.begin(), row.beams.end(),
                     [](const Beam& a, const Beam& b) { return a.azimuth_rad < b.azimuth_rad; });
    sorted.push_back(std::move(row));
  }
  return sorted;
}

double azimuthStep(const std::vector<Row>& rows) {
  std::vector<double> steps;
  for (const Row& row : rows) {
    for (std::size_t k = 1; row.ring >= 0 && k < row.beams.size(); ++k) {
      const double step = row.beams[k].azimuth_rad - row.beams[k - 1].azimuth_rad;
      if (step > 1e-5) steps.push_back(step);  // two returns of one beam have none
    }
  }
  if (steps.empty()) return 0.0;
  std::nth_element(steps.begin(), steps.begin() + static_cast<std::ptrdiff_t>(steps.size() / 2), steps.end());
  return steps[steps.size() / 2];
}

}  // namespace cocalib::plate
