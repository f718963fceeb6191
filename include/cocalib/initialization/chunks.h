#pragma once

#include <vector>

#include "cocalib/initialization/inertial_path.h"

namespace cocalib {

/// Neighbouring measurements [begin, end) over which the IMU is integrated in one go.
struct Chunk {
  std::size_t begin = 0, end = 0;
  InertialPath path;  ///< from the first measurement to `continues ? the next chunk's first : the last` one
  bool continues_in_next = false;  ///< no gap between this chunk and the next
};

/// Splits measurements at `imu_stamps` (rising, IMU clock) into chunks of about `chunk_s`; a gap of the IMU ends a
/// chunk. Measurements that the IMU does not cover are in no chunk.
std::vector<Chunk> splitIntoChunks(const ImuBuffer& imu, const std::vector<TimeNs>& imu_stamps, double chunk_s,
                                   const Eigen::Vector3d& gyro_bias, const Eigen::Vector3d& accel_bias);

}  // namespace cocalib
