#include "cocalib/ros/input_inspection.h"

#include <gtest/gtest.h>

#include "cocalib/io/rig_file.h"
#include "cocalib/ros/conversions.h"
#include "ros/point_cloud_builder.h"

namespace cocalib {
namespace {

constexpr TimeNs kStart = 1'700'000'000'000'000'000;

/// Four seconds of messages as drivers send them to a rig file that may not fit them.
class Inspection : public testing::Test {
 protected:
  std::vector<Finding> inspect(const std::string& lidar_extra = "") {
    const RigConfig rig = parseRig(R"(
imu: {topic: /imu, gyroscope_noise_density: 1.7e-4, gyroscope_random_walk: 1.0e-6,
      accelerometer_noise_density: 5.9e-4, accelerometer_random_walk: 1.0e-5}
camera: {topic: /camera, model: pinhole-radtan, intrinsics: [458.0, 457.0, 367.0, 248.0], distortion: [],
         resolution: [752, 480]}
lidar: {topic: /points, range_noise: 0.03)" +
                                       lidar_extra + "}",
                                   "rig.yaml");
    InputInspection inspection(rig);
    inspection.setCamera(rig.camera->model);
    for (int k = 0; k < 800; ++k) {
      const TimeNs now = kStart + k * 5'000'000LL;
      inspection.addImu(imu(now), now);
      if (k % 10 == 0) inspection.addImage(image(now), now);
      if (k % 20 == 0) inspection.addCloud(cloud(now), now);
    }
    return inspection.doctor().findings();
  }
  void expectOnly(const std::vector<Finding>& findings, const std::string& check) const {
    for (const Finding& finding : findings) EXPECT_EQ(finding.check, check) << finding.words();
    EXPECT_EQ(findings.size(), 1U) << check;
  }

  double gravity_ = 9.81;
  int width_ = 752;
  std::string lidar_frame_ = "lidar_link";
  double camera_late_s_ = 0.0;
  double time_scale_ = 1.0;

 private:
  sensor_msgs::Imu imu(TimeNs now) const {
    sensor_msgs::Imu msg;
    msg.header.stamp = toRosTime(now);
    msg.header.frame_id = "imu_link";
    msg.linear_acceleration.z = gravity_;
    return msg;
  }
  sensor_msgs::Image image(TimeNs now) const {
    sensor_msgs::Image msg;
    msg.header.stamp = toRosTime(now - toNs(camera_late_s_));
    msg.header.frame_id = "camera_optical_frame";
    msg.width = static_cast<std::uint32_t>(width_);
    msg.height = 480;
    return msg;
  }
  sensor_msgs::PointCloud2 cloud(TimeNs now) const {
    test::CloudBuilder builder;
    builder.field("time", sensor_msgs::PointField::FLOAT32);
    for (const test::Return& point : test::makeSweep(60)) builder.point(point.p, {time_scale_ * point.time_s});
    sensor_msgs::PointCloud2 msg = builder.build();
    msg.header.stamp = toRosTime(now - 100'000'000);
    msg.header.frame_id = lidar_frame_;
    return msg;
  }
};

TEST_F(Inspection, FindsNothingWrongWithWhatFits) {
  const std::vector<Finding> findings = inspect();
  EXPECT_TRUE(findings.empty()) << findings.front().words();
}

TEST_F(Inspection, NamesTheUnitOfTheAcceleration) {
  gravity_ = 1.0;
  expectOnly(inspect(), "imu acceleration unit");
}

TEST_F(Inspection, NamesAScaledPicture) {
  width_ = 376;
  expectOnly(inspect(), "camera size");
}

TEST_F(Inspection, NamesAFrame) {
  lidar_frame_ = "velodyne";
  expectOnly(inspect(), "lidar frame");
}

TEST_F(Inspection, NamesAClock) {
  camera_late_s_ = 3.0;
  expectOnly(inspect(), "camera clock");
}

TEST_F(Inspection, NamesAWrongUnitOfThePointTimes) {
  // The rig file says seconds, the driver means milliseconds: whether the reader refuses such clouds or passes them on,
  // the user hears of point_time.
  time_scale_ = 1e3;
  const std::vector<Finding> findings = inspect(", point_time: {field: time, unit: s}");
  ASSERT_FALSE(findings.empty());
  EXPECT_NE(findings.front().remedy.find("point_time"), std::string::npos) << findings.front().words();
}

}  // namespace
}  // namespace cocalib
