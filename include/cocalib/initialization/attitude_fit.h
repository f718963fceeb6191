#pragma once

#include <optional>
#include <vector>

#include "cocalib/initialization/chunks.h"
#include "cocalib/initialization/rotation_initializer.h"

namespace cocalib {

/// Orientation of the IMU in the sensor's map M: gyro within a chunk, the sensor's orientations across chunks.
struct AttitudeFit {
  std::vector<Chunk> chunks;                  ///< paths with the refined gyro bias
  std::vector<Eigen::Quaterniond> R_M_chunk;  ///< of the IMU at each chunk's start
  Eigen::Quaterniond R_imu_sensor;
  Eigen::Vector3d gyro_bias;
  double time_offset_s = 0.0;
  double residual_rad = 0.0;  ///< 1 sigma per axis of the sensor's orientations, robust
};

/// Robust least squares over every chunk's orientation, gyro bias, mounting rotation and clock offset from the sensor's
/// orientations R_M_S. Neighbouring chunks hold together with the gyro but for a small allowance for a map that drifts.
/// @return nothing if the IMU does not cover the stamps
std::optional<AttitudeFit> fitAttitude(const ImuBuffer& imu, const RotationInitialization& start,
                                       const std::vector<TimeNs>& sensor_stamps,
                                       const std::vector<Eigen::Quaterniond>& R_M_S, double chunk_s);

}  // namespace cocalib
