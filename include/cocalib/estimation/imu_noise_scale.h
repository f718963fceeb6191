#pragma once

#include <optional>

#include "cocalib/estimation/chain_system.h"
#include "cocalib/estimation/inertial_chain.h"

namespace cocalib {

/// How many times larger the IMU's white noise is than a rig file says; 1: just that.
struct ImuNoiseScale {
  double gyro = 1.0, accel = 1.0;
};

/// Tells the IMU's noise from what is left of the inertial residuals after a solve.
///
/// Residuals are smaller than the noise, because the states follow it: of n whitened rows J d + r the expected square
/// is n - tr(J P J^T), P the covariance of the states (restricted maximum likelihood, Patterson and Thompson 1971). The
/// trace is that of random signs z, z^T J P J^T z (Hutchinson 1990); the signs are the same in every call.
/// @param chain   with the noise that `solved` was built with
/// @param solved  normal equations at `state`, where the cost is least
/// @return factors on the noise in use, 1 for a sensor of which too few residuals are free to tell; nothing if both are
std::optional<ImuNoiseScale> measureImuNoise(const InertialChain& chain, const WindowState& state,
                                             const ChainSystem& solved);

}  // namespace cocalib
