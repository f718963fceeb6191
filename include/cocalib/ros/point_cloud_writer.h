#pragma once

#include <sensor_msgs/PointCloud2.h>

#include <string>

#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// How drivers name and type the fields of their clouds. All stamp the cloud with the time of its first point.
enum class CloudLayout {
  kVelodyne,     ///< time: float32 [s] since the stamp; ring: uint16
  kOuster,       ///< t: uint32 [ns] since the stamp; ring: uint16; one row per ring, no return = (0, 0, 0)
  kHesai,        ///< timestamp: float64, absolute [s]; ring: uint16
  kRobosense,    ///< timestamp: float64, absolute [s]; ring: uint16; tightly packed
  kLivox,        ///< timestamp: float64, absolute [ns]; line: uint8 (driver 2)
  kLivoxOffset,  ///< offset_time: uint32 [ns] since the stamp; line: uint8
  kNoTime,       ///< x, y, z, intensity only
};

/// A cloud as a driver would publish it. Intensity is a function of the range alone.
sensor_msgs::PointCloud2 toPointCloud2(const LidarScan& scan, CloudLayout layout, const std::string& frame);

}  // namespace cocalib
