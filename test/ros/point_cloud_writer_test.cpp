#include "cocalib/ros/point_cloud_writer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "cocalib/ros/point_cloud_reader.h"

namespace cocalib {
namespace {

// Four rings, 200 columns, a turn in 0.1 s; ring 2 of column 100 has no return.
LidarScan turn() {
  LidarScan scan;
  scan.stamp = TimeNs{1700000000} * 1000000000 + 123456789;
  for (int column = 0; column < 200; ++column) {
    for (int ring = 0; ring < 4; ++ring) {
      LidarPoint point;
      const double azimuth = M_PI - 2.0 * M_PI * column / 200.0, elevation = 0.1 * ring - 0.15;
      point.p = 5.0F * Eigen::Vector3d(std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
                                       std::sin(elevation))
                           .cast<float>();
      if (column == 100 && ring == 2) point.p.setConstant(std::numeric_limits<float>::quiet_NaN());
      point.offset_s = static_cast<float>(column * 5e-4);
      point.ring = static_cast<std::int16_t>(ring);
      scan.points.push_back(point);
    }
  }
  return scan;
}

struct Case {
  CloudLayout layout;
  double time_tolerance_s;  // what the dialect's type can hold
};

TEST(PointCloudWriter, WhatIsWrittenInADialectIsReadBack) {
  const LidarScan written = turn();
  for (const Case& c :
       {Case{CloudLayout::kVelodyne, 1e-8}, Case{CloudLayout::kOuster, 1e-8}, Case{CloudLayout::kHesai, 5e-7},
        Case{CloudLayout::kRobosense, 5e-7}, Case{CloudLayout::kLivox, 5e-7}, Case{CloudLayout::kLivoxOffset, 1e-8}}) {
    PointCloudReader reader(PointTimeOverride{}, 0.5, 100.0, 0.1);
    std::string problem;
    const std::optional<LidarScan> read = reader.read(toPointCloud2(written, c.layout, "lidar"), &problem);
    ASSERT_TRUE(read.has_value()) << problem;
    ASSERT_EQ(read->points.size(), written.points.size() - 1) << reader.description();
    EXPECT_NEAR(toSeconds(read->stamp - written.stamp), 0.0, c.time_tolerance_s);
    for (const LidarPoint& point : read->points) {
      const int column = static_cast<int>(std::lround(point.offset_s / 5e-4));
      const LidarPoint& truth = written.points.at(static_cast<std::size_t>(4 * column + point.ring));
      EXPECT_EQ(point.p, truth.p);
      EXPECT_NEAR(point.offset_s, truth.offset_s, c.time_tolerance_s);
    }
  }
}

TEST(PointCloudWriter, OusterCloudsAreOrganisedByRing) {
  const sensor_msgs::PointCloud2 cloud = toPointCloud2(turn(), CloudLayout::kOuster, "os");
  EXPECT_EQ(cloud.height, 4U);
  EXPECT_EQ(cloud.width, 200U);
  EXPECT_EQ(cloud.point_step, 48U);
  EXPECT_EQ(cloud.data.size(), 4U * 200U * 48U);
  EXPECT_TRUE(cloud.is_dense);
}

TEST(PointCloudWriter, AnEmptyScanMakesAnEmptyCloud) {
  const sensor_msgs::PointCloud2 cloud = toPointCloud2(LidarScan(), CloudLayout::kVelodyne, "lidar");
  EXPECT_EQ(cloud.width, 0U);
  EXPECT_EQ(cloud.data.size(), 0U);
  EXPECT_EQ(cloud.fields.size(), 6U);
}

}  // namespace
}  // namespace cocalib
