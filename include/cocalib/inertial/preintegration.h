#pragma once

#include <Eigen/Core>
#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/imu_noise.h"

namespace cocalib {

/// Motion since the segment's start, seen from the IMU frame at the start, with gravity and start velocity taken out
/// (Forster et al., T-RO 2017), and its Jacobians over the biases.
struct ImuIncrement {
  double dt_s = 0.0;
  Eigen::Quaterniond q = Eigen::Quaterniond::Identity();  ///< R_start_now
  Eigen::Vector3d v = Eigen::Vector3d::Zero();            ///< [m/s]
  Eigen::Vector3d p = Eigen::Vector3d::Zero();            ///< [m]
  Eigen::Matrix3d J_q_bg = Eigen::Matrix3d::Zero();       ///< R(bg + d) ~ R(bg) Exp(J_q_bg d)
  Eigen::Matrix3d J_v_bg = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d J_v_ba = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d J_p_bg = Eigen::Matrix3d::Zero();
  Eigen::Matrix3d J_p_ba = Eigen::Matrix3d::Zero();
};

/// One dense inertial segment: the increment is stored at every sample, so the pose at any time inside is a closed form
/// of the state at the start. Times slightly outside (a few ms) are extrapolated. Immutable; safe from any thread.
class Preintegration {
 public:
  /// @param samples  in order, first at the start and last at the end of the segment; at least two
  /// @param gap_s  of the samples that were interpolated over missing ones, the longest time between two real ones [s]:
  ///               what the motion may have done meanwhile is added to the covariance; 0: none are missing
  /// @throws std::invalid_argument with fewer than two samples
  Preintegration(std::vector<ImuSample> samples, const ImuNoise& noise, const Eigen::Vector3d& gyro_bias,
                 const Eigen::Vector3d& accel_bias, double gap_s = 0.0);

  TimeNs start() const { return samples_.front().stamp; }
  TimeNs end() const { return samples_.back().stamp; }
  double duration() const { return toSeconds(end() - start()); }
  const Eigen::Vector3d& gyroBias() const { return gyro_bias_; }  ///< where it was linearised
  const Eigen::Vector3d& accelBias() const { return accel_bias_; }

  ImuIncrement at(TimeNs stamp) const;
  const ImuIncrement& atEnd() const { return increments_.back(); }

  /// Measured angular rate (bias not removed), linearly interpolated [rad/s].
  Eigen::Vector3d rateAt(TimeNs stamp) const;

  /// Covariance of the whole segment's (p, theta, v) error; theta is a right (IMU-frame) perturbation at the end.
  const Eigen::Matrix<double, 9, 9>& covariance() const { return covariance_; }

 private:
  void addUnseenMotion(double gap_s);
  std::size_t sampleBefore(TimeNs stamp) const;

  std::vector<ImuSample> samples_;
  std::vector<ImuIncrement> increments_;
  Eigen::Vector3d gyro_bias_, accel_bias_;
  Eigen::Matrix<double, 9, 9> covariance_ = Eigen::Matrix<double, 9, 9>::Zero();
};

/// Pose, velocity and rate of the IMU at one time of a segment, with Jacobians over the state at the segment's start.
/// Tangent of the state: [dp dtheta dv dbg dba]; of the pose: [dp dtheta], both in W.
struct TimedPose {
  Pose T_W_I;
  Eigen::Vector3d v_W;  ///< [m/s]
  Eigen::Vector3d w_I;  ///< angular rate without bias, IMU frame [rad/s]
  Eigen::Matrix<double, 6, 15> J_state;
  Vector6d J_gravity;  ///< over gravity's magnitude (it points along -z)
  Vector6d J_time;     ///< over time [1/s]: velocity and angular rate in W
};

/// Pose at `stamp` in closed form. @param start state at the segment's start @param gravity magnitude [m/s^2]
TimedPose timedPose(const Preintegration& segment, const NavState& start, double gravity, TimeNs stamp);

/// State at `stamp` (biases are those of `start`).
NavState propagate(const Preintegration& segment, const NavState& start, double gravity, TimeNs stamp);

}  // namespace cocalib
