#pragma once

#include <Eigen/Core>
#include <optional>

namespace cocalib {

/// f(R) = r^T Q r - 2 q^T r + c over the nine entries r of a rotation matrix, column after column: what least squares
/// that are linear in the entries leave when everything else is eliminated.
struct RotationQuadratic {
  Eigen::Matrix<double, 9, 9> Q = Eigen::Matrix<double, 9, 9>::Zero();
  Eigen::Matrix<double, 9, 1> q = Eigen::Matrix<double, 9, 1>::Zero();
  double c = 0.0;

  double operator()(const Eigen::Matrix3d& R) const;
};

struct RotationMinima {
  Eigen::Matrix3d R;                ///< of the smallest value
  double cost = 0.0;                ///< f(R)
  Eigen::Matrix3d curvature;        ///< f(Exp(d) R) = cost + d^T curvature d to second order
  std::optional<double> runner_up;  ///< cost of the best minimum that is another rotation; nothing if there is none
};

/// Newton's method from the 24 rotations of a cube: no rotation is farther than 63 degrees from one of them.
RotationMinima minimizeOverRotations(const RotationQuadratic& f);

}  // namespace cocalib
