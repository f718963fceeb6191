#pragma once

#include <Eigen/Core>

namespace cocalib {

/// Plane normal . x = offset_m; `normal` has unit length, `offset_m` is the signed distance to the origin [m].
struct Plane {
  Eigen::Vector3d normal = Eigen::Vector3d::UnitZ();
  double offset_m = 0.0;
  /// Where its tangent turns it: near its points, or turning and shifting are one and the same to a rig that has been
  /// driven far from the origin. Constant as long as anything knows the plane. [m]
  Eigen::Vector3d anchor = Eigen::Vector3d::Zero();

  double distance(const Eigen::Vector3d& p) const { return normal.dot(p) - offset_m; }
};

/// Two unit vectors that span the plane of `normal` (a function of the normal alone).
Eigen::Matrix<double, 3, 2> planeBasis(const Eigen::Vector3d& normal);
/// normal <- Exp(basis * d[0..1]) normal, distance(anchor) <- distance(anchor) - d[2].
Plane plus(const Plane& plane, const Eigen::Vector3d& delta);
/// @pre both have the same anchor
Eigen::Vector3d minus(const Plane& plane, const Plane& base);

}  // namespace cocalib
