#pragma once

#include <vector>

#include "cocalib/estimation/inertial_chain.h"

namespace cocalib {

/// How much the IMU has been turned and shifted, by its own account and less its noise, summed over pieces of 2 s.
struct CreditedMotion {
  Eigen::Matrix3d turning = Eigen::Matrix3d::Zero();  ///< u^T turning u: of R u, u in the IMU frame [rad^2 s]
  double shifting = 0.0;                              ///< of the position [m^2 s]
};

/// Estimated orientations and positions jitter, and wander, with what is open: a rig that does not tilt seems to tilt
/// by a milliradian within half a minute, and one whose scale is open to shift by centimetres. Gyro and accelerometer,
/// integrated for 2 s, know nothing of that.
CreditedMotion creditedMotion(const std::vector<NavState>& nodes, const InertialChain& chain);

}  // namespace cocalib
