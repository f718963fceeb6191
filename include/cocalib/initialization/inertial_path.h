#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

#include "cocalib/inertial/imu_buffer.h"

namespace cocalib {

/// What inertial samples alone say about the motion since the start of a path. Frame 0 is the IMU's own at the start;
/// gravity is not in it:
///
///   v_0(t) = v_0 + g_0 t + v,   p_0(t) = p_0 + v_0 t + g_0 t^2 / 2 + p.
struct InertialIncrement {
  double time_s = 0.0;  ///< since the start
  Eigen::Quaterniond R_0_t = Eigen::Quaterniond::Identity();
  Eigen::Vector3d v = Eigen::Vector3d::Zero();     ///< integral of R_0_s (accel - bias) ds [m/s]
  Eigen::Vector3d p = Eigen::Vector3d::Zero();     ///< integral of v [m]
  Eigen::Matrix3d R_bg = Eigen::Matrix3d::Zero();  ///< R_0_t(bg + d) = R_0_t Exp(R_bg d)
  Eigen::Matrix3d v_bg = Eigen::Matrix3d::Zero(), v_ba = Eigen::Matrix3d::Zero();  ///< dv/dbg, dv/dba
  Eigen::Matrix3d p_bg = Eigen::Matrix3d::Zero(), p_ba = Eigen::Matrix3d::Zero();  ///< dp/dbg, dp/dba
  Eigen::Vector3d rate = Eigen::Vector3d::Zero();  ///< angular rate at t, bias removed, IMU frame [rad/s]
};

/// Inertial samples integrated once and densely, so that any instant of the span can be asked for. Rotation by the
/// midpoint rule, velocity and position for an acceleration that is linear in time between samples. Immutable.
class InertialPath {
 public:
  /// Integrates `imu` over [from, to]. @return nothing if the buffer does not cover the interval.
  static std::optional<InertialPath> integrate(const ImuBuffer& imu, TimeNs from, TimeNs to,
                                               const Eigen::Vector3d& gyro_bias, const Eigen::Vector3d& accel_bias);

  TimeNs start() const { return samples_.front().stamp; }
  TimeNs end() const { return samples_.back().stamp; }

  /// Increment from the start to `stamp`; outside the span the last sample on that side is held.
  InertialIncrement at(TimeNs stamp) const;

  /// Only at(stamp).R_0_t, at a fraction of the price.
  Eigen::Quaterniond rotationAt(TimeNs stamp) const;

 private:
  InertialPath() = default;
  std::size_t nodeBefore(TimeNs stamp) const;
  ImuSample sampleAt(std::size_t node, TimeNs stamp) const;

  std::vector<ImuSample> samples_;             ///< biases removed
  std::vector<InertialIncrement> increments_;  ///< at each sample
};

}  // namespace cocalib
