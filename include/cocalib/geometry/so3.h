#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cmath>

namespace cocalib {

/// Cross-product matrix: hat(a) * b == a x b.
inline Eigen::Matrix3d hat(const Eigen::Vector3d& v) {
  Eigen::Matrix3d m;
  m << 0.0, -v.z(), v.y(), v.z(), 0.0, -v.x(), -v.y(), v.x(), 0.0;
  return m;
}

/// Rotation vector [rad] -> unit quaternion; exact to rounding down to zero angle.
inline Eigen::Quaterniond expSo3(const Eigen::Vector3d& phi) {
  const double half_angle = 0.5 * phi.norm();
  // sin(x)/x by its series below 1e-4, where the x^4 term is under rounding.
  const double half_sinc =
      half_angle < 1e-4 ? 0.5 * (1.0 - half_angle * half_angle / 6.0) : 0.5 * std::sin(half_angle) / half_angle;
  Eigen::Quaterniond q;
  q.w() = std::cos(half_angle);
  q.vec() = half_sinc * phi;
  return q.normalized();
}

/// Unit quaternion -> rotation vector of length <= pi [rad].
inline Eigen::Vector3d logSo3(const Eigen::Quaterniond& q) {
  const double sign = q.w() < 0.0 ? -1.0 : 1.0;  // q and -q are one rotation; take the shorter way
  const double sine = q.vec().norm();
  const double cosine = sign * q.w();
  if (sine < 1e-7) return sign * 2.0 * q.vec() / cosine;
  return sign * 2.0 * std::atan2(sine, cosine) / sine * q.vec();
}

/// Left Jacobian of SO(3): Exp(phi + d) ~ Exp(J_l(phi) d) Exp(phi) (Barfoot 2017, eq. 7.77).
inline Eigen::Matrix3d leftJacobianSo3(const Eigen::Vector3d& phi) {
  const double angle2 = phi.squaredNorm();
  const double angle = std::sqrt(angle2);
  // Series below 1e-3, where the neglected terms are under 1e-13.
  const double a = angle < 1e-3 ? 0.5 - angle2 / 24.0 : (1.0 - std::cos(angle)) / angle2;
  const double b = angle < 1e-3 ? 1.0 / 6.0 - angle2 / 120.0 : (angle - std::sin(angle)) / (angle2 * angle);
  const Eigen::Matrix3d W = hat(phi);
  return Eigen::Matrix3d::Identity() + a * W + b * W * W;
}

/// Right Jacobian: Exp(phi + d) ~ Exp(phi) Exp(J_r(phi) d).
inline Eigen::Matrix3d rightJacobianSo3(const Eigen::Vector3d& phi) { return leftJacobianSo3(-phi); }

/// Inverse of leftJacobianSo3, for |phi| < 2 pi (Barfoot 2017, eq. 7.76).
inline Eigen::Matrix3d inverseLeftJacobianSo3(const Eigen::Vector3d& phi) {
  const double angle2 = phi.squaredNorm();
  const double angle = std::sqrt(angle2);
  const double c = angle < 1e-3 ? 1.0 / 12.0 + angle2 / 720.0
                                : 1.0 / angle2 - (1.0 + std::cos(angle)) / (2.0 * angle * std::sin(angle));
  const Eigen::Matrix3d W = hat(phi);
  return Eigen::Matrix3d::Identity() - 0.5 * W + c * W * W;
}

}  // namespace cocalib
