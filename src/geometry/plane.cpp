#include "cocalib/geometry/plane.h"

#include "cocalib/geometry/so3.h"

namespace cocalib {

Eigen::Matrix<double, 3, 2> planeBasis(const Eigen::Vector3d& normal) {
  // The axis least aligned with the normal gives the best-conditioned cross product.
  Eigen::Index axis = 0;
  normal.cwiseAbs().minCoeff(&axis);
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = normal.cross(Eigen::Vector3d::Unit(axis)).normalized();
  basis.col(1) = normal.cross(basis.col(0));
  return basis;
}

Plane plus(const Plane& plane, const Eigen::Vector3d& delta) {
  const Eigen::Vector3d rotation = planeBasis(plane.normal) * delta.head<2>();
  Plane out = plane;
  out.normal = (expSo3(rotation) * plane.normal).normalized();
  out.offset_m = out.normal.dot(plane.anchor) - plane.distance(plane.anchor) + delta[2];
  return out;
}

Eigen::Vector3d minus(const Plane& plane, const Plane& base) {
  const Eigen::Vector3d rotation = logSo3(Eigen::Quaterniond::FromTwoVectors(base.normal, plane.normal));
  Eigen::Vector3d delta;
  delta << planeBasis(base.normal).transpose() * rotation, base.distance(base.anchor) - plane.distance(base.anchor);
  return delta;
}

}  // namespace cocalib
