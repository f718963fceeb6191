/// What a user does to running nodelets: save, freeze, resume, stop, reconfigure, a second run of the same recording.

#include <dynamic_reconfigure/Reconfigure.h>
#include <gtest/gtest.h>
#include <ros/package.h>
#include <ros/ros.h>
#include <std_srvs/Trigger.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <functional>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/io/exports.h"
#include "cocalib/io/result_file.h"
#include "cocalib/ros/conversions.h"
#include "cocalib/ros/estimate_conversions.h"
#include "live_test.h"

namespace cocalib {
namespace {

using test::pace;
using test::playerOf;
using test::runCommand;
using test::waitFor;

namespace fs = std::filesystem;

class Control : public testing::Test {
 protected:
  Control() : spinner_(1) {
    ros::NodeHandle own("~");
    own.getParam("rig", rig_);
    own.getParam("output", output_);
    subscribers_ = {nh_.subscribe("/cocalib/estimate", 100, &Control::onEstimate, this),
                    nh_.subscribe("/tf", 1000, &Control::onTransforms, this),
                    nh_.subscribe("/tf_static", 100, &Control::onStatic, this)};
    spinner_.start();
  }

  void play(const std::string& bag) const { ASSERT_EQ(runCommand(playerOf(rig_, bag)), 0); }
  std::string call(const std::string& service, bool expected = true) const {
    std_srvs::Trigger trigger;
    EXPECT_TRUE(ros::service::call("/cocalib/" + service, trigger)) << service;
    EXPECT_EQ(trigger.response.success, expected) << service << ": " << trigger.response.message;
    return trigger.response.message;
  }
  CalibrationEstimateMsg estimate() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return estimate_;
  }
  /// The mounting of a frame as /tf_static says it.
  std::optional<Pose> staticMounting(const std::string& child) {
    const std::lock_guard<std::mutex> lock(mutex_);
    const auto found = static_.find(child);
    return found == static_.end() ? std::nullopt : std::optional<Pose>(found->second);
  }
  int mountingsOnTf() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return mountings_on_tf_;
  }

  ros::NodeHandle nh_;
  std::string rig_, output_;

 private:
  void onEstimate(const CalibrationEstimateMsg& msg) {
    const std::lock_guard<std::mutex> lock(mutex_);
    estimate_ = msg;
  }
  void onTransforms(const tf2_msgs::TFMessage& msg) {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const auto& transform : msg.transforms) mountings_on_tf_ += transform.header.frame_id == "imu_link" ? 1 : 0;
  }
  void onStatic(const tf2_msgs::TFMessage& msg) {
    const std::lock_guard<std::mutex> lock(mutex_);
    for (const auto& transform : msg.transforms) {
      geometry_msgs::Pose pose;
      pose.position.x = transform.transform.translation.x;
      pose.position.y = transform.transform.translation.y;
      pose.position.z = transform.transform.translation.z;
      pose.orientation = transform.transform.rotation;
      static_[transform.child_frame_id] = fromPoseMsg(pose);
    }
  }

  std::mutex mutex_;
  CalibrationEstimateMsg estimate_;
  std::map<std::string, Pose> static_;
  int mountings_on_tf_ = 0;
  std::vector<ros::Subscriber> subscribers_;
  ros::AsyncSpinner spinner_;
};

TEST_F(Control, SaveFreezeResumeAndPlayAgain) {
  const fs::path directory = fs::temp_directory_path() / ("cocalib_control_" + std::to_string(getpid()));
  fs::create_directories(directory);
  const std::string bag = (directory / "in.bag").string();
  ASSERT_EQ(runCommand("rosrun cocalib simulate --scenario " + ros::package::getPath("cocalib") +
                       "/test/ros/launch_scenario.yaml --bag " + bag + " --seed 3"),
            0);
  fs::remove_all(output_);
  fs::create_directories(output_);

  // A whole run; the player stops it and has it written.
  play(bag);
  const CalibrationEstimate written = loadResult(output_ + "/calibration.yaml");
  ASSERT_TRUE(written.camera.valid && written.lidar.valid) << written.message;
  EXPECT_TRUE(fs::exists(output_ + "/report.html"));
  for (const std::string& name : exportNames()) EXPECT_TRUE(fs::exists(output_ + "/" + name)) << name;
  EXPECT_NE(estimate().progress.find("mm"), std::string::npos) << estimate().progress;
  // The doctor compares arrivals by the wall clock: at a tenth of the pace it takes streams for late that are not.
  if (pace() == 1.0) {
    EXPECT_TRUE(estimate().findings.empty()) << estimate().findings.front();
  }

  // Frozen: static transforms, those of the file.
  call("freeze");
  ASSERT_TRUE(waitFor([&] { return staticMounting("camera_optical_frame") && staticMounting("lidar_link"); }, 5.0));
  EXPECT_LT(staticMounting("camera_optical_frame")->minus(written.calibration.T_imu_camera).norm(), 1e-9);
  EXPECT_LT(staticMounting("lidar_link")->minus(written.calibration.T_imu_lidar).norm(), 1e-9);
  EXPECT_TRUE(waitFor([&] { return estimate().stage == "frozen"; }, 5.0)) << estimate().stage;  // another topic

  // Resumed: nothing is known, and nothing can be frozen.
  call("resume");
  EXPECT_TRUE(waitFor([&] { return !estimate().camera.valid && !estimate().lidar.valid; }, 5.0));
  call("freeze", false);

  // Another publisher of the lidar's frame is named.
  ros::Publisher rival = nh_.advertise<tf2_msgs::TFMessage>("/tf_static", 1, true);
  tf2_msgs::TFMessage transforms;
  transforms.transforms.resize(1);
  transforms.transforms[0].header.frame_id = "base_link";
  transforms.transforms[0].child_frame_id = "lidar_link";
  transforms.transforms[0].transform.rotation.w = 1.0;
  rival.publish(transforms);
  const auto rivalNamed = [&] {
    const std::vector<std::string> findings = estimate().findings;
    return std::any_of(findings.begin(), findings.end(), [](const std::string& finding) {
      return finding.find(ros::this_node::getName()) != std::string::npos;
    });
  };
  EXPECT_TRUE(waitFor(rivalNamed, 5.0));

  // tf switched off, the same recording again: the clock was set back, and everything works as the first time.
  dynamic_reconfigure::Reconfigure reconfigure;
  reconfigure.request.config.bools.resize(1);
  reconfigure.request.config.bools[0].name = "publish_tf";
  reconfigure.request.config.bools[0].value = 0;
  ASSERT_TRUE(ros::service::call("/cocalib/fuser/set_parameters", reconfigure));
  ros::WallDuration(0.5).sleep();
  const int before = mountingsOnTf();
  play(bag);
  EXPECT_EQ(mountingsOnTf(), before);
  const CalibrationEstimate again = loadResult(output_ + "/calibration.yaml");
  ASSERT_TRUE(again.camera.valid && again.lidar.valid) << again.message;
  EXPECT_LT(again.calibration.T_imu_camera.minus(written.calibration.T_imu_camera).head<3>().norm(), 0.02);
  EXPECT_LT(again.calibration.T_imu_lidar.minus(written.calibration.T_imu_lidar).head<3>().norm(), 0.02);

  fs::remove(output_ + "/calibration.yaml");
  EXPECT_NE(call("save").find("calibration.yaml"), std::string::npos);
  EXPECT_TRUE(fs::exists(output_ + "/calibration.yaml"));
  call("reset");
  EXPECT_TRUE(waitFor([&] { return !estimate().camera.valid; }, 5.0));
  fs::remove_all(directory);
}

}  // namespace
}  // namespace cocalib

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "control");
  return RUN_ALL_TESTS();
}
