#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/inertial/imu_buffer.h"
#include "cocalib/initialization/rotation_initializer.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Metric pose of a sensor in a frame M of its own (board frame, lidar map) at one of its stamps.
struct SensorPose {
  TimeNs stamp = 0;  ///< sensor clock
  Pose T_M_S;
  /// Projection onto the directions of M in which the position means something.
  Eigen::Matrix3d seen_directions = Eigen::Matrix3d::Identity();
};

/// What alignment finds: lever arm, gravity and the IMU's states, in a gravity-aligned world W.
struct Alignment {
  Pose T_imu_sensor;
  double gravity = 9.80665;  ///< [m/s^2]
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();
  Pose T_W_M;                                                   ///< identity for alignFromTracks()
  std::vector<NavState> states;                                 ///< one per input pose or frame, same order, IMU clock
  Eigen::Vector3d lever_arm_sigma_m = Eigen::Vector3d::Zero();  ///< 1 sigma, formal
  Eigen::Vector3d lever_arm_guess = Eigen::Vector3d::Zero();    ///< prior that it was found with, and
  double lever_arm_prior_m = 1.0;                               ///< its sigma
  double residual_m = 0.0;                                      ///< RMS of the position residuals
  double time_offset_s = 0.0;  ///< t_imu = t_sensor + time_offset, refined; the states stand at it
};

struct AlignmentParams {
  double chunk_s =
      2.0;  ///< within a chunk position is integrated from the IMU; every chunk has its own start and velocity
  double position_sigma_m = 0.02;                             ///< noise of a sensor position
  double accel_bias_sigma = 0.3;                              ///< prior of the accelerometer bias [m/s^2]
  Eigen::Vector3d lever_arm_guess = Eigen::Vector3d::Zero();  ///< centre of the lever arm's prior [m]
  double lever_arm_prior_m = 1.0;                             ///< prior sigma of the lever arm [m]
  double max_lever_arm_sigma_m = 0.1;  ///< accepted only when the least certain axis is better than this

  /// Settings for motion that does not show the whole lever arm: what it leaves open is taken from the guess (to 0.1
  /// m), or, without one, from the sensor being somewhere on the rig (to 1 m).
  static AlignmentParams open(const std::optional<Pose>& guess_T_imu_sensor);
  bool isOpen() const { return max_lever_arm_sigma_m > lever_arm_prior_m; }
};

/// Gravity, velocities, accelerometer bias and lever arm by one linear least-squares from metric sensor poses, with
/// robust re-weighting. Gravity's magnitude is then checked against 9.7..9.9 m/s^2 and made consistent.
std::optional<Alignment> alignFromPoses(const ImuBuffer& imu, const RotationInitialization& rotation,
                                        const std::vector<SensorPose>& poses, const AlignmentParams& params,
                                        std::string* reason = nullptr);

/// Same without metric poses: bearings of tracks; the scale comes from the accelerometer. Landmarks are eliminated from
/// the linear constraints bearing x (X - camera position) = 0, re-weighted by depth (after Martinelli, IJCV 2014, with
/// rotation known from the gyro). Frames: bearings in the camera frame with track ids.
struct BearingFrame {
  TimeNs stamp = 0;  ///< camera clock
  std::vector<std::uint32_t> ids;
  std::vector<Eigen::Vector3d> bearings_C;  ///< unit length
};
std::optional<Alignment> alignFromTracks(const ImuBuffer& imu, const RotationInitialization& rotation,
                                         const std::vector<BearingFrame>& frames, const AlignmentParams& params,
                                         std::string* reason = nullptr);

}  // namespace cocalib
