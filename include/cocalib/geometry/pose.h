#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>

#include "cocalib/geometry/so3.h"

namespace cocalib {

using Vector6d = Eigen::Matrix<double, 6, 1>;
using Matrix6d = Eigen::Matrix<double, 6, 6>;

/// Rigid transform T_A_B: takes coordinates in B to coordinates in A.
///
/// Tangent `delta` (6x1): rows 0-2 translation [m], rows 3-5 rotation [rad], both in A:
///   t <- t + delta.head<3>(),  R <- Exp(delta.tail<3>()) * R.
/// It is the order and the fixed-axis meaning of geometry_msgs/PoseWithCovariance, so a
/// covariance over `delta` goes into a message without reordering or rotation.
struct Pose {
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();
  Eigen::Vector3d t = Eigen::Vector3d::Zero();

  Eigen::Vector3d operator*(const Eigen::Vector3d& p_B) const { return q * p_B + t; }
  Pose operator*(const Pose& T_B_C) const { return {(q * T_B_C.q).normalized(), q * T_B_C.t + t}; }
  Pose inverse() const { return {q.conjugate(), -(q.conjugate() * t)}; }
  Pose plus(const Vector6d& delta) const { return {(expSo3(delta.tail<3>()) * q).normalized(), t + delta.head<3>()}; }
  /// Tangent that leads from `base` to this pose: base.plus(minus(base)) == *this.
  Vector6d minus(const Pose& base) const {
    Vector6d delta;
    delta << t - base.t, logSo3(q * base.q.conjugate());
    return delta;
  }
  Eigen::Matrix3d R() const { return q.toRotationMatrix(); }
};

}  // namespace cocalib
