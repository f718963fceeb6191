#pragma once

#include <Eigen/Core>

namespace cocalib {

/// Plane normal . x = offset_m; `normal` has unit length, `offset_m` is the signed distance to the origin [m].
struct Plane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double offset_m = 0.0;

  double distance(const Eigen::Vector3d& p) const { return normal.dot(p) - offset_m; }
};

}  // namespace cocalib
