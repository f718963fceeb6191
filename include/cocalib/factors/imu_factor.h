#pragma once

#include <Eigen/Core>

#include "cocalib/inertial/preintegration.h"

namespace cocalib {

using Vector15d = Eigen::Matrix<double, 15, 1>;
using Matrix15d = Eigen::Matrix<double, 15, 15>;

/// State tangent [dp dtheta dv dbg dba], position and rotation as in Pose::plus().
NavState plus(const NavState& state, const Vector15d& delta);
/// Tangent that leads from `base` to `state`.
Vector15d minus(const NavState& state, const NavState& base);

/// Whitened residual of one inertial segment between two states (paper Eq. 3; Forster et al. 2017), with its Jacobians.
///
///   r_p = R_i^T (p_j - p_i - v_i dt - g dt^2 / 2) - dp(b_i)       r_bg = bg_j - bg_i
///   r_q = Log(dR(b_i)^T R_i^T R_j)                                r_ba = ba_j - ba_i
///   r_v = R_i^T (v_j - v_i - g dt) - dv(b_i)
struct ImuResidual {
  Vector15d r;
  Matrix15d J_i, J_j;
  Vector15d J_gravity;  ///< over gravity's magnitude
};

/// Immutable; safe from any thread.
class ImuFactor {
 public:
  /// @param segment must outlive the factor
  ImuFactor(const Preintegration& segment, const ImuNoise& noise);

  ImuResidual evaluate(const NavState& state_i, const NavState& state_j, double gravity) const;

 private:
  const Preintegration* segment_;
  Matrix15d sqrt_information_;
};

}  // namespace cocalib
