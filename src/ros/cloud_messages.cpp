#include "cocalib/ros/cloud_messages.h"

#include <sensor_msgs/point_cloud2_iterator.h>

#include <boost/make_shared.hpp>
#include <cstddef>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

sensor_msgs::PointCloud2Ptr emptyCloud(TimeNs stamp, const std::string& frame) {
  auto msg = boost::make_shared<sensor_msgs::PointCloud2>();
  msg->header.stamp = toRosTime(stamp);
  msg->header.frame_id = frame;
  msg->height = 1;
  msg->is_dense = true;
  return msg;
}

}  // namespace

sensor_msgs::PointCloud2Ptr toCloudMsg(const DeskewedCloud& cloud, const std::vector<float>& distances,
                                       const std::string& world_frame) {
  sensor_msgs::PointCloud2Ptr msg = emptyCloud(cloud.stamp, world_frame);
  sensor_msgs::PointCloud2Modifier modifier(*msg);
  using sensor_msgs::PointField;
  modifier.setPointCloud2Fields(6, "x", 1, PointField::FLOAT32, "y", 1, PointField::FLOAT32, "z", 1,
                                PointField::FLOAT32, "distance", 1, PointField::FLOAT32, "plane", 1, PointField::INT32,
                                "calibration_version", 1, PointField::UINT32);
  if (cloud.points_W.empty()) return msg;  // an iterator may not even be made over no points
  modifier.resize(cloud.points_W.size());
  sensor_msgs::PointCloud2Iterator<float> xyz(*msg, "x");
  sensor_msgs::PointCloud2Iterator<float> distance(*msg, "distance");
  sensor_msgs::PointCloud2Iterator<std::int32_t> plane(*msg, "plane");
  sensor_msgs::PointCloud2Iterator<std::uint32_t> version(*msg, "calibration_version");
  std::size_t written = 0;
  for (std::size_t i = 0; i < cloud.points_W.size(); ++i) {
    const Eigen::Vector3f& p = cloud.points_W[i];
    if (!p.allFinite()) continue;
    for (int axis = 0; axis < 3; ++axis) xyz[axis] = p[axis];
    *distance = i < distances.size() ? distances[i] : -1.0F;
    *plane = i < cloud.plane.size() ? cloud.plane[i] : -1;
    *version = cloud.calibration_version;
    ++xyz, ++distance, ++plane, ++version, ++written;
  }
  modifier.resize(written);
  return msg;
}

sensor_msgs::PointCloud2Ptr toCloudMsg(const std::vector<Eigen::Vector3f>& points_W, TimeNs stamp,
                                       const std::string& world_frame) {
  sensor_msgs::PointCloud2Ptr msg = emptyCloud(stamp, world_frame);
  sensor_msgs::PointCloud2Modifier modifier(*msg);
  modifier.setPointCloud2FieldsByString(1, "xyz");
  if (points_W.empty()) return msg;
  modifier.resize(points_W.size());
  sensor_msgs::PointCloud2Iterator<float> xyz(*msg, "x");
  std::size_t written = 0;
  for (const Eigen::Vector3f& p : points_W) {
    if (!p.allFinite()) continue;
    for (int axis = 0; axis < 3; ++axis) xyz[axis] = p[axis];
    ++xyz, ++written;
  }
  modifier.resize(written);
  return msg;
}

}  // namespace cocalib
