#pragma once

#include <sensor_msgs/PointCloud2.h>

#include <string>
#include <vector>

#include "cocalib/calibrators/lidar_inertial_calibrator.h"

namespace cocalib {

/// A deskewed sweep in the world frame: x, y, z and distance (float32, m), plane (int32 number, -1: none) and
/// calibration_version (uint32, the same for all points of a cloud): 24 bytes, all of them aligned. Points that are not
/// finite are left out.
/// @param distances  of each point to its plane [m], -1: none
sensor_msgs::PointCloud2Ptr toCloudMsg(const DeskewedCloud& cloud, const std::vector<float>& distances,
                                       const std::string& world_frame);

/// Points only.
sensor_msgs::PointCloud2Ptr toCloudMsg(const std::vector<Eigen::Vector3f>& points_W, TimeNs stamp,
                                       const std::string& world_frame);

}  // namespace cocalib
