// Real VLP-16 clouds, where the optional data folder is there.

#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <filesystem>
#include <string>
#include <vector>

#include "cocalib/lidar/lidar_odometry.h"
#include "cocalib/lidar/plane_map.h"
#include "cocalib/ros/point_cloud_reader.h"

namespace cocalib {
namespace {

std::vector<LidarScan> readScans(const std::string& path) {
  rosbag::Bag bag(path, rosbag::bagmode::Read);
  PointCloudReader reader(PointTimeOverride{}, 0.5, 100.0, 0.1);
  std::vector<LidarScan> scans;
  for (const rosbag::MessageInstance& message : rosbag::View(bag, rosbag::TopicQuery("/velodyne_points"))) {
    const auto cloud = message.instantiate<sensor_msgs::PointCloud2>();
    std::string problem;
    const auto scan = cloud ? reader.read(*cloud, &problem) : std::nullopt;
    EXPECT_TRUE(scan) << problem;
    if (scan) scans.push_back(*scan);
  }
  return scans;
}

class RealClouds : public testing::TestWithParam<std::pair<const char*, std::size_t>> {
 protected:
  void SetUp() override {
    const std::string path = std::string("../shared/data/") + GetParam().first;
    if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not there";
    scans_ = readScans(path);
    ASSERT_EQ(scans_.size(), GetParam().second);
  }

  std::vector<LidarScan> scans_;
};

TEST_P(RealClouds, EveryOneHasPlanes) {
  for (std::size_t i = 0; i < scans_.size(); ++i) {
    PlaneMap map{PlaneMap::Params{}};
    for (const LidarPoint& point : scans_[i].points) map.addPoint(point.p.cast<double>());
    map.extract();
    ASSERT_GE(map.planeCount(), 1) << "cloud " << i;
    std::size_t claimed = 0;
    double square = 0.0;
    for (const LidarPoint& point : scans_[i].points) {
      const Eigen::Vector3d p = point.p.cast<double>();
      const int plane = map.planeAt(p, p.normalized());
      if (plane < 0) continue;
      const double distance = map.planes()[static_cast<std::size_t>(plane)].distance(p);
      square += distance * distance;
      ++claimed;
    }
    EXPECT_GT(claimed, 500U) << "cloud " << i;
    EXPECT_LT(std::sqrt(square / static_cast<double>(claimed)), PlaneMap::Params{}.sigma()) << "cloud " << i;
  }
}

TEST_P(RealClouds, OdometrySurvivesThem) {
  LidarOdometry odometry{LidarOdometry::Params{}};
  for (const LidarScan& scan : scans_) {
    const LidarOdometry::Result result = odometry.addScan(scan);
    EXPECT_TRUE(result.T_M_L_end.t.allFinite());
    EXPECT_NEAR(result.T_M_L_end.q.norm(), 1.0, 1e-9);
  }
}

INSTANTIATE_TEST_SUITE_P(Recordings, RealClouds,
                         testing::Values(std::make_pair("acfr_vlp16_board/acfr_vlp16_board.bag", std::size_t{18}),
                                         std::make_pair("maplab_anymal/maplab_anymal.bag", std::size_t{24})),
                         [](const auto& info) { return info.index == 0 ? "acfr" : "maplab"; });

}  // namespace
}  // namespace cocalib
