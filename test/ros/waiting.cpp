/// What the services answer while the camera's driver has not come yet, or says what cannot be used; what is said of a
/// topic that carries something else.

#include <gtest/gtest.h>
#include <ros/ros.h>
#include <sensor_msgs/CameraInfo.h>
#include <sensor_msgs/Imu.h>
#include <std_srvs/Trigger.h>

#include <algorithm>
#include <functional>
#include <string>
#include <vector>

#include "cocalib/ros/messages.h"
#include "live_test.h"

namespace cocalib {
namespace {

using test::waitFor;

const std::vector<std::string> kSessionServices = {"save", "reset", "start", "stop", "freeze", "resume", "flush"};

std_srvs::TriggerResponse answerOf(const std::string& service) {
  std_srvs::Trigger trigger;
  EXPECT_TRUE(ros::service::call("/cocalib/" + service, trigger)) << service;
  return trigger.response;
}

sensor_msgs::CameraInfo cameraInfo(double focal_length) {
  sensor_msgs::CameraInfo info;
  info.width = 376;
  info.height = 240;
  info.distortion_model = "plumb_bob";
  info.D = {-0.12, 0.04, 0.0006, -0.0004, 0.0};
  info.K = {focal_length, 0.0, 187.5, 0.0, focal_length, 119.5, 0.0, 0.0, 1.0};
  return info;
}

TEST(Waiting, EveryServiceSaysWhatIsMissing) {
  ros::NodeHandle nh;
  std::vector<std::string> all = kSessionServices;
  all.insert(all.end(), {"visual_inertial/flush", "lidar_inertial/flush"});
  for (const std::string& service : all) ASSERT_TRUE(ros::service::waitForService("/cocalib/" + service, 10000));
  all.pop_back();
  for (const std::string& service : all) {
    const std_srvs::TriggerResponse answer = answerOf(service);
    EXPECT_FALSE(answer.success) << service;
    EXPECT_NE(answer.message.find("waiting for the camera model on /camera/camera_info"), std::string::npos)
        << service << ": " << answer.message;
  }
  EXPECT_TRUE(answerOf("lidar_inertial/flush").success);  // needs no camera

  // A driver without a calibration, as most are delivered.
  ros::Publisher publisher = nh.advertise<sensor_msgs::CameraInfo>("/camera/camera_info", 5, true);
  publisher.publish(cameraInfo(0.0));
  const auto complains = [] { return answerOf("save").message.find("cannot be used") != std::string::npos; };
  EXPECT_TRUE(waitFor(complains, 5.0)) << answerOf("save").message;
  EXPECT_FALSE(answerOf("stop").success);

  publisher.publish(cameraInfo(230.0));
  for (const std::string service : {"visual_inertial/flush", "flush"}) {
    EXPECT_TRUE(waitFor([&] { return answerOf(service).success; }, 5.0)) << answerOf(service).message;
  }
  for (const std::string& service : kSessionServices) {
    const std_srvs::TriggerResponse answer = answerOf(service);
    EXPECT_EQ(answer.success, service != "freeze") << service << ": " << answer.message;
    EXPECT_EQ(answer.message.find("waiting for"), std::string::npos) << service << ": " << answer.message;
  }

  // The rig file names another sensor's topic.
  const ros::Publisher other = nh.advertise<sensor_msgs::Imu>("/velodyne_points", 5);
  const auto finds = [&](const std::string& words) {
    const auto estimate =
        ros::topic::waitForMessage<CalibrationEstimateMsg>("/cocalib/estimate", nh, ros::Duration(2.0));
    if (!estimate) return false;
    const auto& findings = estimate->findings;
    return std::any_of(findings.begin(), findings.end(),
                       [&](const std::string& finding) { return finding.find(words) != std::string::npos; });
  };
  EXPECT_TRUE(waitFor(
      [&] { return finds("/velodyne_points: carries sensor_msgs/Imu, needed is sensor_msgs/PointCloud2"); }, 5.0));
  EXPECT_TRUE(waitFor([&] { return finds("/imu/data: nothing has come on it"); }, 10.0));
}

}  // namespace
}  // namespace cocalib

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "waiting");
  return RUN_ALL_TESTS();
}
