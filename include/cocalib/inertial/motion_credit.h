#pragma once

#include <Eigen/Core>
#include <vector>

#include "cocalib/inertial/imu_buffer.h"
#include "cocalib/inertial/preintegration.h"

namespace cocalib {

/// How much the IMU has been turned and shifted, by its own account and less its noise, summed over pieces of 2 s.
///
/// Estimated orientations and positions jitter, and wander, with what is open: a rig that does not tilt seems to tilt
/// by a milliradian within half a minute, and one whose scale is open to shift by centimetres. Gyro and accelerometer,
/// integrated for 2 s, know nothing of that.
class MotionCredit {
 public:
  explicit MotionCredit(const ImuNoise& noise) : noise_(noise) {}

  /// The segments one after the other, without gaps. @param start  state at the segment's start: tilt and biases
  void add(const NavState& start, const Preintegration& segment);

  /// u^T turning u: of R u, u in the IMU frame [rad^2 s].
  const Eigen::Matrix3d& turning() const { return turning_; }
  /// Of the position [m^2 s].
  double shifting() const { return shifting_; }

 private:
  /// What the IMU alone says of its motion since the piece began; gravity left out.
  struct Piece {
    std::vector<double> times_s = {0.0};
    std::vector<Eigen::Matrix3d> turns = {Eigen::Matrix3d::Identity()};
    std::vector<Eigen::Vector3d> path = {Eigen::Vector3d::Zero()};
    Eigen::Vector3d velocity = Eigen::Vector3d::Zero();

    double duration() const { return times_s.back(); }
    void add(const NavState& start, const Preintegration& segment);
    Eigen::Matrix3d turnBeyond(double gyro_noise) const;
    double shiftBeyond(double accel_noise) const;
  };

  ImuNoise noise_;
  Piece piece_;
  Eigen::Matrix3d turning_ = Eigen::Matrix3d::Zero();
  double shifting_ = 0.0;
};

/// Credited shifting from which on a scale shows: 3 mm for 5 s, beside which what jitters adds little [m^2 s].
constexpr double kEnoughShifting = 0.003 * 0.003 * 5.0;

/// Whether the IMU has been shifted between two times, by its own account: if not, a camera that follows features
/// cannot tell near from far. Only the gyro's bias need be known.
bool shiftShows(const ImuBuffer& imu, TimeNs from, TimeNs to, const Eigen::Vector3d& gyro_bias);

}  // namespace cocalib
