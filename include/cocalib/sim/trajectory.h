#pragma once

#include <array>
#include <vector>

#include "cocalib/geometry/pose.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/sim/scenario.h"

namespace cocalib::sim {

/// The true motion of the IMU: position and roll, pitch, yaw are sums of sinusoids that swell from standstill, all with
/// analytic derivatives; in a building the drive through it is added. Times are seconds since the scenario's epoch on
/// the IMU clock; before 0 the rig stands still. Immutable; safe from any thread.
class Trajectory {
 public:
  explicit Trajectory(const Scenario& scenario);

  struct Kinematics {
    Pose T_W_I;
    Eigen::Vector3d v_W;      ///< velocity of I in W [m/s]
    Eigen::Vector3d a_W;      ///< acceleration of I in W, without gravity [m/s^2]
    Eigen::Vector3d omega_I;  ///< body rate [rad/s]
  };
  Kinematics at(double t) const;

  Pose T_W_I(double t) const;
  Eigen::Vector3d velocity(double t) const { return at(t).v_W; }
  Eigen::Vector3d acceleration(double t) const { return at(t).a_W; }
  Eigen::Vector3d bodyRate(double t) const { return at(t).omega_I; }

  /// Pose and velocity at a stamp of the IMU clock; biases are left zero (see trueImuBias()).
  NavState stateAt(TimeNs stamp) const;

  double timeOf(TimeNs stamp) const { return toSeconds(stamp - epoch_); }
  TimeNs stampOf(double t) const { return epoch_ + toNs(t); }

 private:
  struct Sinusoid {
    double amplitude, omega, phase;
  };
  using Axes = std::array<Eigen::Vector3d, 6>;  // x y z roll pitch yaw, each with its first two derivatives
  /// @param derivatives  0 or 2: how many of them are needed
  Axes axes(double t, int derivatives) const;
  Eigen::Vector3d axis(int index, double t, const Eigen::Vector3d& ramp, int derivatives) const;
  Eigen::Vector3d ramp(double t) const;
  /// A swell with its first two derivatives, until the rig is parked.
  Eigen::Vector3d fade(double t, const Eigen::Vector3d& swell) const;
  /// Adds the way through the building to x, y and yaw; nothing in a room.
  void addDrive(double t, const Eigen::Vector3d& ramp, Axes* axes) const;

  TimeNs epoch_;
  double ramp_s_, planar_for_s_, parked_after_s_;
  bool driven_;
  std::array<std::vector<Sinusoid>, 6> sinusoids_;
};

}  // namespace cocalib::sim
