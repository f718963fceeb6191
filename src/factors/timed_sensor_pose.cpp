#include "cocalib/factors/timed_sensor_pose.h"

namespace cocalib {

TimedSensorPose timedSensorPose(const Preintegration& segment, const NavState& start, double gravity,
                                const Pose& T_imu_sensor, double time_offset_s, TimeNs sensor_stamp) {
  const TimedPose imu = timedPose(segment, start, gravity, sensor_stamp + toNs(time_offset_s));
  const Eigen::Matrix3d R_W_I = imu.T_W_I.R();
  const Eigen::Vector3d lever_W = R_W_I * T_imu_sensor.t;
  // A turn of the IMU moves the sensor's origin around it: dt_S = dt_I + dtheta x lever.
  Matrix6d carry = Matrix6d::Identity();
  carry.block<3, 3>(0, 3) = -hat(lever_W);

  TimedSensorPose out;
  out.T_W_S = imu.T_W_I * T_imu_sensor;
  out.J_state = carry * imu.J_state;
  out.J_gravity = carry * imu.J_gravity;
  out.J_calibration.setZero();
  out.J_calibration.block<3, 3>(0, 0) = R_W_I;
  out.J_calibration.block<3, 3>(3, 3) = R_W_I;
  out.J_calibration.col(6) = carry * imu.J_time;
  out.v_W = out.J_calibration.col(6).head<3>();
  out.w_S = T_imu_sensor.q.conjugate() * imu.w_I;
  return out;
}

}  // namespace cocalib
