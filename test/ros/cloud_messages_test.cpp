#include "cocalib/ros/cloud_messages.h"

#include <gtest/gtest.h>
#include <sensor_msgs/point_cloud2_iterator.h>

#include <cmath>

namespace cocalib {
namespace {

DeskewedCloud threePoints() {
  DeskewedCloud cloud;
  cloud.stamp = 1'700'000'000'000'000'000;
  cloud.points_W = {{1.0F, 2.0F, 3.0F}, {NAN, 0.0F, 0.0F}, {4.0F, 5.0F, 6.0F}};
  cloud.plane = {7, 8, -1};
  cloud.calibration_version = 42;
  return cloud;
}

TEST(CloudMessages, HoldEveryFinitePointWithItsPlane) {
  const auto msg = toCloudMsg(threePoints(), {0.01F, 0.02F}, "map");
  EXPECT_EQ(msg->header.frame_id, "map");
  ASSERT_EQ(msg->width * msg->height, 2U);
  ASSERT_EQ(msg->data.size(), msg->point_step * 2U);
  sensor_msgs::PointCloud2ConstIterator<float> x(*msg, "x"), distance(*msg, "distance");
  sensor_msgs::PointCloud2ConstIterator<std::int32_t> plane(*msg, "plane");
  sensor_msgs::PointCloud2ConstIterator<std::uint32_t> version(*msg, "calibration_version");
  EXPECT_EQ(x[0], 1.0F);
  EXPECT_EQ(x[2], 3.0F);
  EXPECT_EQ((x + 1)[1], 5.0F);
  EXPECT_EQ(distance[0], 0.01F);
  EXPECT_EQ((distance + 1)[0], -1.0F);  // none was given
  EXPECT_EQ(plane[0], 7);
  EXPECT_EQ((plane + 1)[0], -1);
  EXPECT_EQ(version[0], 42U);
}

TEST(CloudMessages, KeepEveryNumberAligned) {
  const auto msg = toCloudMsg(threePoints(), {}, "map");
  EXPECT_EQ(msg->point_step % 4, 0U);
  for (const sensor_msgs::PointField& field : msg->fields) EXPECT_EQ(field.offset % 4, 0U) << field.name;
}

TEST(CloudMessages, MayBeEmpty) {
  DeskewedCloud none = threePoints();
  none.points_W.clear();
  for (const auto& msg : {toCloudMsg(none, {}, "map"), toCloudMsg(std::vector<Eigen::Vector3f>(), none.stamp, "map")}) {
    EXPECT_EQ(msg->width * msg->height, 0U);
    EXPECT_TRUE(msg->data.empty());
    EXPECT_FALSE(msg->fields.empty());
  }
}

}  // namespace
}  // namespace cocalib
