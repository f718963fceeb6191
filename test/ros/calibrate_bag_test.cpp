#include <gtest/gtest.h>
#include <rosbag/bag.h>
#include <sensor_msgs/Imu.h>
#include <sensor_msgs/PointCloud2.h>
#include <sensor_msgs/point_cloud2_iterator.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

namespace {

namespace fs = std::filesystem;

constexpr const char* kNoise =
    "gyroscope_noise_density: 1.745e-4, gyroscope_random_walk: 1.0e-6, "
    "accelerometer_noise_density: 5.884e-4, accelerometer_random_walk: 1.0e-5";

struct Outcome {
  int exit_code = -1;
  std::string out, error;
};

std::string contents(const fs::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), std::istreambuf_iterator<char>()};
}

int lineCount(const std::string& text) { return static_cast<int>(std::count(text.begin(), text.end(), '\n')); }

/// Runs the program as a user would, in a directory of its own with a rig file and small bags.
class CalibrateBag : public testing::Test {
 protected:
  void SetUp() override {
    // One test at a time uses it, and each begins with an empty one.
    directory_ = fs::temp_directory_path() / ("calibrate_bag_test_" + std::to_string(getpid()));
    fs::remove_all(directory_);
    fs::create_directories(directory_);
    writeRig("");
  }
  void TearDown() override { fs::remove_all(directory_); }

  /// @param more  further lines of the file
  void writeRig(const std::string& more) const {
    std::ofstream(path("rig.yaml")) << "imu: {topic: /imu/data, frame: imu_link, " << kNoise << "}\n"
                                    << "lidar: {topic: /points, frame: lidar_link, range_noise: 0.03}\n"
                                    << more;
  }

  /// Five seconds of a resting IMU, and clouds of `points` points each.
  void writeBag(int points, const std::string& cloud_topic = "/points") const {
    rosbag::Bag bag(path("in.bag"), rosbag::bagmode::Write);
    for (int i = 0; i < 1000; ++i) {
      sensor_msgs::Imu imu;
      imu.header.stamp = ros::Time(1'700'000'000) + ros::Duration(0.005 * i);
      imu.linear_acceleration.z = 9.81;
      bag.write("/imu/data", imu.header.stamp, imu);
    }
    for (int i = 0; i < 50; ++i) {
      sensor_msgs::PointCloud2 cloud;
      cloud.header.stamp = ros::Time(1'700'000'000) + ros::Duration(0.1 * i);
      cloud.height = 1;
      sensor_msgs::PointCloud2Modifier modifier(cloud);
      modifier.setPointCloud2FieldsByString(1, "xyz");
      modifier.resize(points);
      if (points > 0) {  // an iterator may not even be made over no points
        sensor_msgs::PointCloud2Iterator<float> x(cloud, "x");
        for (int k = 0; k < points; ++k, ++x) {
          const double azimuth = 2.0 * M_PI * k / points;
          x[0] = static_cast<float>(4.0 * std::cos(azimuth));
          x[1] = static_cast<float>(-4.0 * std::sin(azimuth));
          x[2] = static_cast<float>(0.1 * (k % 16));
        }
      }
      bag.write(cloud_topic, cloud.header.stamp, cloud);
    }
  }

  Outcome run(const std::string& arguments) const {
    const std::string command =
        std::string(CALIBRATE_BAG) + " " + arguments + " > " + path("out") + " 2> " + path("err");
    const int status = std::system(command.c_str());
    return {WIFEXITED(status) ? WEXITSTATUS(status) : -1, contents(path("out")), contents(path("err"))};
  }
  Outcome runOnBag(const std::string& more = "") const {
    return run("--rig " + path("rig.yaml") + " --bag " + path("in.bag") + " --output " + path("result") + " " + more);
  }
  std::string path(const std::string& name) const { return (directory_ / name).string(); }

  /// Exit 1, the words, one line, no result.
  void expectRefused(const Outcome& outcome, const std::string& words) const {
    EXPECT_EQ(outcome.exit_code, 1) << outcome.error;
    EXPECT_NE(outcome.error.find(words), std::string::npos) << outcome.error;
    EXPECT_EQ(lineCount(outcome.error.substr(std::min(outcome.error.find("calibrate_bag:"), outcome.error.size()))), 1);
    EXPECT_FALSE(fs::exists(path("result/calibration.yaml")));
  }

  fs::path directory_;
};

TEST_F(CalibrateBag, WrongUsageIsTwo) {
  EXPECT_EQ(run("").exit_code, 2);
  EXPECT_EQ(run("--rig a --bag b --duration 0").exit_code, 2);
  EXPECT_EQ(run("--rig a --bag b --start -1").exit_code, 2);
  EXPECT_EQ(run("--rig a --bag b --no-such-option").exit_code, 2);
  EXPECT_EQ(run("--rig a --bag b stray").exit_code, 2);
  EXPECT_EQ(run("--help").exit_code, 0);
}

TEST_F(CalibrateBag, MissingFilesAreNamed) {
  expectRefused(runOnBag(), "in.bag");
  writeBag(100);
  fs::remove(path("rig.yaml"));
  expectRefused(runOnBag(), "rig.yaml");
}

TEST_F(CalibrateBag, WhatIsNoBagIsRefused) {
  std::ofstream(path("in.bag")) << "this is no bag\n";
  expectRefused(runOnBag(), "in.bag");
  fs::resize_file(path("in.bag"), 0);
  expectRefused(runOnBag(), "in.bag");
}

TEST_F(CalibrateBag, MisspeltKeyIsNamed) {
  writeBag(100);
  writeRig("targett: {type: checkerboard}\n");
  expectRefused(runOnBag(), "targett");
}

TEST_F(CalibrateBag, MissingTopicListsWhatThereIs) {
  writeBag(100, "/other_points");
  const Outcome outcome = runOnBag();
  expectRefused(outcome, "/points");
  EXPECT_NE(outcome.error.find("/other_points"), std::string::npos);
}

TEST_F(CalibrateBag, TopicOfAnotherTypeIsExplained) {
  writeBag(100, "/cloud");
  std::ofstream(path("rig.yaml")) << "imu: {topic: /cloud, frame: imu_link, " << kNoise << "}\n"
                                  << "lidar: {topic: /imu/data, frame: lidar_link, range_noise: 0.03}\n";
  expectRefused(runOnBag(), "sensor_msgs/PointCloud2");
}

TEST_F(CalibrateBag, CloudsWithoutPointsAreRefused) {
  writeBag(0);
  expectRefused(runOnBag(), "/points");
}

TEST_F(CalibrateBag, PartBehindTheEndIsRefused) {
  writeBag(100);
  expectRefused(runOnBag("--start 100"), "--start");
}

TEST_F(CalibrateBag, UnusableOutputIsSaidBeforeTheWork) {
  writeBag(100);
  std::ofstream(path("result")) << "a file where the directory should be";
  const Outcome outcome = runOnBag();
  EXPECT_EQ(outcome.exit_code, 1);
  EXPECT_NE(outcome.error.find("result"), std::string::npos);
}

TEST_F(CalibrateBag, RestIsInsufficientDataAndRepeatsByteByByte) {
  writeBag(2000);
  const Outcome outcome = runOnBag();
  ASSERT_EQ(outcome.exit_code, 0) << outcome.error;
  EXPECT_NE(outcome.out.find("insufficient_data"), std::string::npos) << outcome.out;
  const std::string first = contents(path("result/calibration.yaml"));
  EXPECT_NE(first.find("status: insufficient_data"), std::string::npos);
  EXPECT_EQ(first.find("nan"), std::string::npos);
  EXPECT_TRUE(fs::exists(path("result/convergence.csv")));
  EXPECT_TRUE(fs::exists(path("result/convergence.png")));
  ASSERT_EQ(runOnBag().exit_code, 0);
  EXPECT_EQ(contents(path("result/calibration.yaml")), first);
}

}  // namespace
