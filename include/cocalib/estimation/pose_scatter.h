#pragma once

#include "cocalib/estimation/chain_system.h"
#include "cocalib/estimation/window_state.h"
#include "cocalib/factors/timed_sensor_pose.h"

namespace cocalib {

/// Adds a quadratic over a sensor pose's tangent (H, b) to the system, by the pose's chain rule.
/// @param node    the node of the pose's segment
/// @param column  first column of the sensor's calibration block (GlobalLayout::kCamera or kLidar)
void scatterPose(const TimedSensorPose& pose, int node, int column, const Matrix6d& H, const Vector6d& b,
                 ChainSystem* system);

/// Adds the cross term between a sensor pose and the globals at `other_column`. The number of columns is part of the
/// type: this is called for every plane in every few milliseconds of a sweep.
template <int M>
void scatterPoseGlobal(const TimedSensorPose& pose, int node, int column, const Eigen::Matrix<double, 6, M>& H,
                       int other_column, ChainSystem* system) {
  constexpr int kG = GlobalLayout::kGravity;
  system->coupling(node).template middleCols<M>(other_column).noalias() += pose.J_state.transpose() * H;
  const Eigen::Matrix<double, 7, M> calibration = pose.J_calibration.transpose() * H;
  const Eigen::Matrix<double, 1, M> gravity = pose.J_gravity.transpose() * H;
  auto& G = system->H_global;
  G.template block<7, M>(column, other_column) += calibration;
  G.template block<M, 7>(other_column, column) += calibration.transpose();
  G.template block<1, M>(kG, other_column) += gravity;
  G.template block<M, 1>(other_column, kG) += gravity.transpose();
}

/// Adds the cross term between two poses of the same sensor; H is d^2/(da db), a at node_a, b at node_b.
void scatterPosePair(const TimedSensorPose& a, int node_a, const TimedSensorPose& b, int node_b, int column,
                     const Matrix6d& H, ChainSystem* system);

}  // namespace cocalib
