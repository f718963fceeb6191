#pragma once

#include "cocalib/estimation/inertial_chain.h"
#include "cocalib/estimation/window_state.h"
#include "cocalib/factors/timed_sensor_pose.h"

namespace cocalib {

/// Pose of the lidar at `stamp` (lidar clock), from the node before it.
inline TimedSensorPose lidarPose(const WindowState& state, const InertialChain& chain, int node, TimeNs stamp) {
  return timedSensorPose(chain.segment(node), state.nodes[static_cast<std::size_t>(node)], state.gravity,
                         state.calibration.T_imu_lidar, state.calibration.lidar_time_offset_s, stamp);
}

/// The node that lidarPose() takes at `stamp`.
inline int lidarNode(const WindowState& state, TimeNs stamp) {
  return nodeAt(state.nodes, stamp + toNs(state.calibration.lidar_time_offset_s));
}

}  // namespace cocalib
