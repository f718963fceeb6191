#pragma once

#include "cocalib/inertial/preintegration.h"

namespace cocalib {

/// Pose of a sensor in the world at one of its own stamps, with Jacobians of its tangent ([dp dtheta] in W) over all
/// that it depends on. Factors are written against the sensor pose alone; this chain rule is applied once a pose.
struct TimedSensorPose {
  Pose T_W_S;
  Eigen::Vector3d v_W;  ///< velocity of the sensor's origin [m/s]
  Eigen::Vector3d w_S;  ///< angular rate in the sensor frame [rad/s]
  Eigen::Matrix<double, 6, 15> J_state;
  Eigen::Matrix<double, 6, 7> J_calibration;  ///< T_imu_sensor (6), time offset (1)
  Vector6d J_gravity;
};

/// T_W_S(stamp) = T_W_I(stamp + offset) T_imu_sensor.
TimedSensorPose timedSensorPose(const Preintegration& segment, const NavState& start, double gravity,
                                const Pose& T_imu_sensor, double time_offset_s, TimeNs sensor_stamp);

}  // namespace cocalib
