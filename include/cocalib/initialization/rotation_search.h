#pragma once

#include <optional>
#include <vector>

#include "cocalib/initialization/inertial_path.h"
#include "cocalib/initialization/rotation_initializer.h"

namespace cocalib {

/// Mounting rotation and gyro bias that fit best at one clock offset.
struct RotationCandidate {
  double time_offset_s = 0.0;
  Eigen::Quaterniond R_imu_sensor = Eigen::Quaterniond::Identity();
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();
  double residual_rad = 0.0;  ///< median over the pairs
};

/// Result of trying every offset of the search range.
struct RotationSearch {
  RotationCandidate best;
  /// Smallest residual of another valley of the residual over the offset; nothing if there is only one valley.
  std::optional<double> runner_up_residual_rad;
};

/// Mean angular rates of the IMU over the pairs' intervals, shifted by an offset [rad/s]. Bias not removed.
std::vector<Eigen::Vector3d> meanGyroRates(const InertialPath& gyro,
                                           const std::vector<RelativeSensorRotation>& rotations, double offset_s);

/// Weighted, centred fit w_imu = R w_sensor + bias over the pairs, robust against gross outliers; closed form in every
/// re-weighting, so it needs no start. @param gyro path integrated without bias, long enough for the whole range
RotationSearch searchRotation(const InertialPath& gyro, const std::vector<RelativeSensorRotation>& rotations,
                              double max_time_offset_s);

/// Refines a candidate by Gauss-Newton over mounting, gyro bias and offset (rotations are then composed exactly, rates
/// no longer averaged) with Cauchy weights whose scale follows the residuals.
/// @return nothing if the IMU does not cover the pairs
std::optional<RotationInitialization> refineRotation(const ImuBuffer& imu,
                                                     const std::vector<RelativeSensorRotation>& rotations,
                                                     const RotationCandidate& start);

}  // namespace cocalib
