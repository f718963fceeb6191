// The readers on real recordings, which lie beside the repository and not in it.

#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <rosbag/view.h>

#include <array>
#include <cmath>
#include <fstream>
#include <string>

#include "cocalib/io/rig_file.h"
#include "cocalib/ros/conversions.h"
#include "cocalib/ros/image_reader.h"
#include "cocalib/ros/imu_reader.h"
#include "cocalib/ros/point_cloud_reader.h"

namespace cocalib {
namespace {

/// Path of a recording, empty if it is not there.
std::string recording(const std::string& name) {
  const std::string path = "../shared/data/" + name + "/" + name + ".bag";
  return std::ifstream(path).good() ? path : "";
}

/// Calls `use` with every message of a topic.
template <typename Message, typename Use>
void forEach(const std::string& path, const std::string& topic, const Use& use) {
  rosbag::Bag bag(path, rosbag::bagmode::Read);
  rosbag::View view(bag, rosbag::TopicQuery(topic));
  for (const rosbag::MessageInstance& instance : view) use(*instance.instantiate<Message>());
}

/// Times and azimuths of a VLP-16 without times: one turn of 0.1 s, clockwise, in firing order.
void expectVelodyneSweep(const LidarScan& scan) {
  EXPECT_GT(scan.points.size(), 15000U);
  float latest = 0.0F;
  for (std::size_t i = 0; i < scan.points.size(); ++i) {
    const LidarPoint& point = scan.points[i];
    ASSERT_GE(point.offset_s, 0.0F);
    // The driver's azimuths step back by less than a firing (0.4 deg, 0.11 ms) where it interpolates them.
    if (i > 0) {
      ASSERT_GT(point.offset_s, scan.points[i - 1].offset_s - 2e-4F);
    }
    latest = std::max(latest, point.offset_s);
  }
  EXPECT_GT(latest, 0.098F);
  EXPECT_LT(latest, 0.103F);
}

TEST(Recordings, VelodyneWithRingButWithoutTimes) {
  const std::string path = recording("acfr_vlp16_board");
  if (path.empty()) GTEST_SKIP() << "recording acfr_vlp16_board is not in ../shared/data";
  const RigConfig rig = loadRigFile("cfg/rigs/acfr.yaml");
  PointCloudReader reader(*rig.lidar);
  int scans = 0;
  forEach<sensor_msgs::PointCloud2>(path, rig.lidar->topic, [&](const sensor_msgs::PointCloud2& msg) {
    std::string problem;
    const std::optional<LidarScan> scan = reader.read(msg, &problem);
    ASSERT_TRUE(scan) << problem;
    expectVelodyneSweep(*scan);
    const std::optional<RingTable> rings = RingTable::build(scan->points);
    ASSERT_TRUE(rings);
    EXPECT_EQ(rings->count(), 16);
    for (const LidarPoint& point : scan->points) ASSERT_EQ(rings->ring(point.p), point.ring);
    ++scans;
  });
  EXPECT_EQ(scans, 18);
  EXPECT_NE(reader.warning().find("azimuth, clockwise"), std::string::npos) << reader.warning();
  EXPECT_NE(reader.description().find("rings: field 'ring'"), std::string::npos) << reader.description();
}

TEST(Recordings, VelodyneWithNeitherRingNorTimes) {
  const std::string path = recording("maplab_anymal");
  if (path.empty()) GTEST_SKIP() << "recording maplab_anymal is not in ../shared/data";
  const RigConfig rig = loadRigFile("cfg/rigs/maplab.yaml");
  PointCloudReader reader(*rig.lidar);
  int scans = 0;
  forEach<sensor_msgs::PointCloud2>(path, rig.lidar->topic, [&](const sensor_msgs::PointCloud2& msg) {
    std::string problem;
    const std::optional<LidarScan> scan = reader.read(msg, &problem);
    ASSERT_TRUE(scan) << problem;
    expectVelodyneSweep(*scan);
    std::array<int, 16> counts{};
    for (const LidarPoint& point : scan->points) {
      const double elevation_deg = std::asin(static_cast<double>(point.p.z() / point.p.norm())) * 180.0 / 3.14159265;
      ASSERT_EQ(point.ring, std::lround((elevation_deg + 15.0) / 2.0));
      ++counts[static_cast<std::size_t>(point.ring)];
    }
    ++scans;
  });
  EXPECT_EQ(scans, 24);
  EXPECT_NE(reader.warning().find("16 from the elevation"), std::string::npos) << reader.warning();
}

TEST(Recordings, CompressedPicturesAndInertialSamples) {
  const std::string path = recording("euroc_mh01");
  if (path.empty()) GTEST_SKIP() << "recording euroc_mh01 is not in ../shared/data";
  const RigConfig rig = loadRigFile("cfg/rigs/euroc.yaml");
  int pictures = 0;
  TimeNs previous = 0;
  forEach<sensor_msgs::CompressedImage>(path, rig.camera->topic, [&](const sensor_msgs::CompressedImage& msg) {
    if (++pictures % 20 != 1) return;  // decoding all takes seconds
    std::string problem;
    const std::optional<ImageFrame> frame = readImage(msg, &problem);
    ASSERT_TRUE(frame) << problem;
    EXPECT_EQ(frame->gray.cols, rig.camera->model->width());
    EXPECT_EQ(frame->gray.rows, rig.camera->model->height());
    EXPECT_GT(frame->stamp, previous);
    previous = frame->stamp;
  });
  EXPECT_EQ(pictures, 280);
  int samples = 0;
  double gravity = 0.0;
  forEach<sensor_msgs::Imu>(path, rig.imu.topic, [&](const sensor_msgs::Imu& msg) {
    std::string problem;
    const std::optional<ImuSample> sample = readImu(msg, &problem);
    ASSERT_TRUE(sample) << problem;
    gravity += sample->accel.norm();
    ++samples;
  });
  EXPECT_EQ(samples, 3230);
  EXPECT_NEAR(gravity / samples, 9.81, 0.3);
}

}  // namespace
}  // namespace cocalib
