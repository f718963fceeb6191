/// Runs calibrate.launch on a small simulated bag, under the master that rostest started, and looks at what a user
/// gets: tf while it runs, an end by itself, the result; and a second run that goes on from it.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <ros/package.h>
#include <ros/ros.h>
#include <tf2_msgs/TFMessage.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "cocalib/io/result_file.h"
#include "cocalib/ros/estimate_conversions.h"
#include "live_test.h"

namespace cocalib {
namespace {

using test::poseOf;
using test::runCommand;

namespace fs = std::filesystem;

/// What comes by while the launch file runs.
class Listener {
 public:
  Listener() : spinner_(1) {
    subscribers_ = {nh_.subscribe("/tf", 1000, &Listener::onTransforms, this),
                    nh_.subscribe("/cocalib/estimate", 100, &Listener::onEstimate, this),
                    nh_.subscribe("/diagnostics", 100, &Listener::onDiagnostics, this)};
    spinner_.start();
  }
  void stop() { spinner_.stop(); }

  std::map<std::string, int> transforms;       // "parent child" -> how many
  std::map<std::string, std::string> dropped;  // counters of queues -> last value
  bool all_finite = true;
  int estimates = 0;

 private:
  void onTransforms(const tf2_msgs::TFMessage& msg) {
    for (const auto& transform : msg.transforms) {
      ++transforms[transform.header.frame_id + " " + transform.child_frame_id];
      const auto& t = transform.transform.translation;
      const auto& q = transform.transform.rotation;
      all_finite = all_finite && std::isfinite(t.x + t.y + t.z + q.x + q.y + q.z + q.w);
    }
  }
  void onEstimate(const CalibrationEstimateMsg&) { ++estimates; }
  void onDiagnostics(const diagnostic_msgs::DiagnosticArray& msg) {
    for (const auto& status : msg.status) {
      for (const auto& value : status.values) {
        if (value.key.find("dropped in queue") != std::string::npos) dropped[status.name + value.key] = value.value;
      }
    }
  }

  ros::NodeHandle nh_;
  std::vector<ros::Subscriber> subscribers_;
  ros::AsyncSpinner spinner_;
};

/// A small picture and a quarter of a minute: far from the best, but a wrong sign or frame would be decimetres off.
void expectNearTruth(const CalibrationEstimate& estimate, const YAML::Node& truth) {
  const Vector6d camera_error = estimate.calibration.T_imu_camera.minus(poseOf(truth["camera"]["T_imu_camera"]));
  const Vector6d lidar_error = estimate.calibration.T_imu_lidar.minus(poseOf(truth["lidar"]["T_imu_lidar"]));
  EXPECT_LT(camera_error.head<3>().norm(), 0.02);
  EXPECT_LT(camera_error.tail<3>().norm(), 0.01);
  EXPECT_LT(lidar_error.head<3>().norm(), 0.02);
  EXPECT_LT(lidar_error.tail<3>().norm(), 0.01);
}

TEST(CalibrateLaunch, BagEndsByItselfWithTfAndResultAndGoesOnFromIt) {
  const fs::path directory = fs::temp_directory_path() / ("calibrate_launch_" + std::to_string(getpid()));
  fs::create_directories(directory);
  const std::string here = directory.string();
  const std::string scenario = ros::package::getPath("cocalib") + "/test/ros/launch_scenario.yaml";
  ASSERT_EQ(runCommand("rosrun cocalib simulate --scenario " + scenario + " --bag " + here + "/in.bag --seed 3"), 0);

  Listener listener;
  const auto launch = [&](const std::string& arguments) {
    return runCommand("timeout -s INT 600 roslaunch cocalib calibrate.launch rviz:=false rig:=" + here +
                      "/in.rig.yaml bag:=" + here + "/in.bag rate:=" + std::to_string(test::pace()) + " " + arguments +
                      " < /dev/null");
  };
  ASSERT_EQ(launch("output:=" + here + "/result"), 0);
  listener.stop();

  const YAML::Node truth = YAML::LoadFile(here + "/in.truth.yaml");
  const CalibrationEstimate estimate = loadResult(here + "/result/calibration.yaml");
  EXPECT_NE(estimate.status, Status::kInsufficientData);
  expectNearTruth(estimate, truth);

  EXPECT_GT(listener.transforms["imu_link camera_optical_frame"], 10);
  EXPECT_GT(listener.transforms["imu_link lidar_link"], 10);
  EXPECT_GT(listener.transforms["world imu_link"], 10);
  EXPECT_TRUE(listener.all_finite);
  EXPECT_GT(listener.estimates, 1);
  EXPECT_FALSE(listener.dropped.empty());
  for (const auto& [what, value] : listener.dropped) EXPECT_EQ(value.substr(0, 2), "0 ") << what;
  for (const char* name : {"convergence.csv", "convergence.png", "overlay_before.png", "overlay_after.png"}) {
    EXPECT_TRUE(fs::exists(directory / "result" / name)) << name;
  }

  // Half of the recording once more, from that result: it begins with what is known and adds to it.
  ASSERT_EQ(launch("output:=" + here + "/again start:=8 initial_guess:=" + here + "/result/calibration.yaml"), 0);
  const CalibrationEstimate again = loadResult(here + "/again/calibration.yaml");
  EXPECT_LT(again.duration_s, 0.6 * estimate.duration_s);
  for (int i = 0; i < 14; ++i) EXPECT_LT(again.covariance(i, i), estimate.covariance(i, i)) << i;
  expectNearTruth(again, truth);
  fs::remove_all(directory);
}

}  // namespace
}  // namespace cocalib

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "calibrate_launch");
  return RUN_ALL_TESTS();
}
