#pragma once

#include "cocalib/geometry/pose.h"

namespace cocalib {

/// Covariance of T^-1 over its own tangent, from that of T. With R' = R^T and t' = -R^T t:
///   dtheta' = -R^T dtheta,   dt' = -R^T (dt + hat(t) dtheta).
inline Matrix6d covarianceOfInverse(const Pose& T, const Matrix6d& covariance) {
  const Eigen::Matrix3d R_t = T.R().transpose();
  Matrix6d J = Matrix6d::Zero();
  J.topLeftCorner<3, 3>() = J.bottomRightCorner<3, 3>() = -R_t;
  J.topRightCorner<3, 3>() = -R_t * hat(T.t);
  return J * covariance * J.transpose();
}

}  // namespace cocalib
