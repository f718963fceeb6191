#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/inertial/imu_buffer.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Rotation of a sensor between two of its own stamps, p_a = R_a_b p_b, in the sensor frame.
struct RelativeSensorRotation {
  TimeNs stamp_a = 0, stamp_b = 0;  ///< sensor clock
  Eigen::Quaterniond R_a_b;
};

struct RotationInitializerParams {
  double max_time_offset_s = 0.3;  ///< search range of the clock offset, each way
  double min_singular_value =
      0.25;  ///< second-smallest singular value of the normalised hand-eye problem that counts as determined
  double max_residual_rad = 0.03;  ///< median residual above which the result is refused
  int min_pairs = 30;
};

/// Mounting rotation, clock offset and gyro bias from rotations alone.
struct RotationInitialization {
  Eigen::Quaterniond R_imu_sensor;
  double time_offset_s = 0.0;                           ///< t_imu = t_sensor + time_offset
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();  ///< [rad/s]
  double median_residual_rad = 0.0;
  double second_singular_value = 0.0;  ///< of the rotation axes' spread: 0 when all rotations share one axis
  double rotation_sigma_rad = 0.0;     ///< of the least certain axis of R_imu_sensor, formal, 1 sigma
  double time_offset_sigma_s = 0.0;    ///< formal, 1 sigma
};

/// Clock offset by correlating angular rates of sensor and gyro over the search range (each offset with its own best
/// mounting and gyro bias, so no guess is needed), then hand-eye rotation (paper Eq. 1) jointly with gyro bias and
/// offset by robust (re-weighted) least squares. Up to about a third of the pairs may be grossly wrong.
/// @return nothing while the motion does not determine it; `reason` then says why, in words for the user
std::optional<RotationInitialization> initializeRotation(const ImuBuffer& imu,
                                                         const std::vector<RelativeSensorRotation>& rotations,
                                                         const RotationInitializerParams& params,
                                                         std::string* reason = nullptr);

/// What rotations tell that all share one axis: everything but the turn about that axis.
struct AxisRotation {
  RotationInitialization rotation;  ///< one of the mountings that fit; the formal sigmas are left at 0
  Eigen::Vector3d axis_imu;         ///< Exp(angle axis_imu) R_imu_sensor fits as well, for every angle
};

/// Clock offset (to the search's 5 ms), gyro bias and the axis, for which rotations need no second axis.
/// @return nothing while the rig does not turn at all, or its rates and the sensor's do not agree; `reason` says which
std::optional<AxisRotation> rotationAboutOneAxis(const ImuBuffer& imu,
                                                 const std::vector<RelativeSensorRotation>& rotations,
                                                 const RotationInitializerParams& params,
                                                 std::string* reason = nullptr);

}  // namespace cocalib
