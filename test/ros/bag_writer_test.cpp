#include "cocalib/ros/bag_writer.h"

#include <gtest/gtest.h>
#include <rosbag/view.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/Imu.h>

#include <cstdio>
#include <fstream>
#include <opencv2/core.hpp>

#include "cocalib/ros/camera_info.h"
#include "cocalib/ros/image_reader.h"
#include "cocalib/ros/imu_reader.h"

namespace cocalib {
namespace {

constexpr TimeNs kStamp = TimeNs{1700000000} * 1000000000 + 123456789;

bool exists(const std::string& path) { return std::ifstream(path).good(); }

TEST(BagWriter, WhatIsWrittenIsReadBack) {
  const std::string path = testing::TempDir() + "bag_writer_test.bag";
  std::remove(path.c_str());
  const ImuSample sample{kStamp, {0.1, -0.2, 0.3}, {1.0, 2.0, 9.8}};
  cv::Mat gray(4, 6, CV_8UC1, cv::Scalar(7));
  gray.at<std::uint8_t>(2, 3) = 200;
  const CameraModel camera =
      CameraModel::fromName("pinhole-equi", {460, 461, 375.5, 239.5}, {0.1, 0.2, 0.3, 0.4}, 752, 480);
  {
    BagWriter writer(path);
    writer.writeImu(kStamp, sample, "/imu", "imu_link");
    writer.writeCameraInfo(kStamp, kStamp, camera, "/info", "cam");
    writer.writeImage(kStamp + 5, {kStamp, gray}, "/image", "cam");
    EXPECT_FALSE(exists(path));  // not before it is complete
    writer.finish();
  }
  EXPECT_FALSE(exists(path + ".partial"));
  rosbag::Bag bag(path);
  int messages = 0;
  for (const rosbag::MessageInstance& message : rosbag::View(bag)) {
    ++messages;
    if (const auto imu = message.instantiate<sensor_msgs::Imu>()) {
      const std::optional<ImuSample> read = readImu(*imu, nullptr);
      ASSERT_TRUE(read.has_value());
      EXPECT_EQ(read->stamp, kStamp);
      EXPECT_EQ(read->gyro, sample.gyro);
      EXPECT_EQ(read->accel, sample.accel);
    } else if (const auto image = message.instantiate<sensor_msgs::Image>()) {
      const std::optional<ImageFrame> read = readImage(*image, nullptr);
      ASSERT_TRUE(read.has_value());
      EXPECT_EQ(cv::norm(read->gray, gray, cv::NORM_INF), 0.0);
      EXPECT_EQ(read->stamp, kStamp);
    } else if (const auto info = message.instantiate<sensor_msgs::CameraInfo>()) {
      const std::optional<CameraModel> read = readCameraInfo(*info, nullptr);
      ASSERT_TRUE(read.has_value());
      EXPECT_EQ(read->intrinsics(), camera.intrinsics());
      EXPECT_EQ(read->coefficients(), camera.coefficients());
      EXPECT_EQ(read->distortion(), camera.distortion());
    }
  }
  EXPECT_EQ(messages, 3);
  bag.close();
  std::remove(path.c_str());
}

TEST(BagWriter, AnAbandonedBagLeavesNothing) {
  const std::string path = testing::TempDir() + "bag_writer_abandoned.bag";
  { BagWriter(path).writeImu(kStamp, {kStamp, {0, 0, 0}, {0, 0, 9.8}}, "/imu", "imu_link"); }
  EXPECT_FALSE(exists(path));
  EXPECT_FALSE(exists(path + ".partial"));
}

TEST(BagWriter, ADirectoryThatIsNotThereIsNamed) {
  try {
    BagWriter writer("/nowhere/at/all.bag");
    FAIL();
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/at/all.bag"), std::string::npos);
  }
}

}  // namespace
}  // namespace cocalib
