#pragma once

#include <Eigen/Core>

#include "cocalib/geometry/pose.h"

namespace cocalib::test {

/// Central differences of `residual` (x -> Nx1 vector) over a D-dimensional tangent; `plus(x, delta)` moves x. N x D.
/// With step 1e-6 and values of order 1 the error is near 1e-10.
template <int N, int D, typename X, typename Plus, typename Residual>
Eigen::Matrix<double, N, D> numericJacobian(const X& x, const Plus& plus, const Residual& residual,
                                            double step = 1e-6) {
  Eigen::Matrix<double, N, D> J;
  for (int i = 0; i < D; ++i) {
    const Eigen::Matrix<double, D, 1> delta = step * Eigen::Matrix<double, D, 1>::Unit(i);
    J.col(i) = (residual(plus(x, delta)) - residual(plus(x, -delta))) / (2.0 * step);
  }
  return J;
}

/// The same over a pose's tangent.
template <int N, typename Residual>
Eigen::Matrix<double, N, 6> numericPoseJacobian(const Pose& T, const Residual& residual, double step = 1e-6) {
  return numericJacobian<N, 6>(
      T, [](const Pose& pose, const Vector6d& d) { return pose.plus(d); }, residual, step);
}

}  // namespace cocalib::test
