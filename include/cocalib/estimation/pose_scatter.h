#pragma once

#include "cocalib/estimation/chain_system.h"
#include "cocalib/factors/timed_sensor_pose.h"

namespace cocalib {

/// Adds a quadratic over a sensor pose's tangent (H, b) to the system, by the pose's chain rule.
/// @param node    the node of the pose's segment
/// @param column  first column of the sensor's calibration block (GlobalLayout::kCamera or kLidar)
void scatterPose(const TimedSensorPose& pose, int node, int column, const Matrix6d& H, const Vector6d& b,
                 ChainSystem* system);

/// Adds the cross term between a sensor pose and the globals at `other_column`: H is 6xM.
void scatterPoseGlobal(const TimedSensorPose& pose, int node, int column, const Eigen::Ref<const Eigen::MatrixXd>& H,
                       int other_column, ChainSystem* system);

/// Adds the cross term between two poses of the same sensor; H is d^2/(da db), a at node_a, b at node_b.
void scatterPosePair(const TimedSensorPose& a, int node_a, const TimedSensorPose& b, int node_b, int column,
                     const Matrix6d& H, ChainSystem* system);

}  // namespace cocalib
