#pragma once

#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sim/scenario.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib::sim {

struct ImuBias {
  Eigen::Vector3d gyro = Eigen::Vector3d::Zero();   ///< [rad/s]
  Eigen::Vector3d accel = Eigen::Vector3d::Zero();  ///< [m/s^2]
};

/// True biases at the start (and all the time, unless the scenario has a bias walk): per axis a random sign and
/// 0.5 to 1.5 times the scenario's size.
ImuBias trueImuBias(const Scenario& scenario);

/// Samples of the whole recording, from 0.1 s before the trajectory's time 0 to 0.1 s after its end: the true rate
/// and specific force at each instant, white noise of density * sqrt(rate), and the biases.
/// @param biases  where to put the true biases of each sample, or null
std::vector<ImuSample> simulateImu(const Scenario& scenario, const Trajectory& trajectory,
                                   std::vector<ImuBias>* biases = nullptr);

}  // namespace cocalib::sim
