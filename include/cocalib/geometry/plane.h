#pragma once

#include <Eigen/Core>

namespace cocalib {

/// Plane normal . x = offset_m; `normal` has unit length, `offset_m` is the signed distance to the origin [m].
struct Plane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double offset_m = 0.0;

  double distance(const Eigen::Vector3d& p) const { return normal.dot(p) - offset_m; }
};

/// Two unit vectors that span the plane of `normal` (a function of the normal alone).
Eigen::Matrix<double, 3, 2> planeBasis(const Eigen::Vector3d& normal);
/// normal <- Exp(basis * d[0..1]) normal, offset <- offset + d[2].
Plane plus(const Plane& plane, const Eigen::Vector3d& delta);
Eigen::Vector3d minus(const Plane& plane, const Plane& base);

}  // namespace cocalib
