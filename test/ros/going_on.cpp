/// What happens to running nodelets in daily use: each of them restarted in the running manager, viewers that come when
/// everything is over, a recording that is played in a loop by rosbag's own player.

#include <gtest/gtest.h>
#include <nodelet/NodeletLoad.h>
#include <nodelet/NodeletUnload.h>
#include <ros/package.h>
#include <ros/ros.h>
#include <sensor_msgs/Image.h>
#include <sensor_msgs/PointCloud2.h>
#include <std_srvs/Trigger.h>
#include <unistd.h>
#include <visualization_msgs/MarkerArray.h>
#include <yaml-cpp/yaml.h>

#include <cstdlib>
#include <filesystem>
#include <functional>
#include <mutex>
#include <set>
#include <string>
#include <vector>

#include "cocalib/ros/estimate_conversions.h"
#include "live_test.h"

namespace cocalib {
namespace {

using test::pace;
using test::playerOf;
using test::poseOf;
using test::Program;
using test::waitFor;

namespace fs = std::filesystem;

constexpr double kRecordingS = 26.0;

class GoingOn : public testing::Test {
 protected:
  GoingOn() : spinner_(1), directory_(fs::temp_directory_path() / ("cocalib_going_on_" + std::to_string(getpid()))) {
    ros::NodeHandle("~").getParam("rig", rig_);
    subscriber_ = nh_.subscribe("/cocalib/estimate", 100, &GoingOn::onEstimate, this);
    spinner_.start();
    fs::create_directories(directory_);
    bag_ = (directory_ / "in.bag").string();
  }
  ~GoingOn() override { fs::remove_all(directory_); }

  void simulate() {
    Program simulate("rosrun cocalib simulate --scenario " + ros::package::getPath("cocalib") +
                     "/test/ros/launch_scenario.yaml --duration " + std::to_string(kRecordingS) + " --bag " + bag_ +
                     " --seed 3");
    ASSERT_EQ(simulate.wait(), 0);
    truth_ = YAML::LoadFile((directory_ / "in.truth.yaml").string());
  }
  void call(const std::string& service) const {
    std_srvs::Trigger trigger;
    EXPECT_TRUE(ros::service::call("/cocalib/" + service, trigger)) << service;
    EXPECT_TRUE(trigger.response.success) << service << ": " << trigger.response.message;
  }
  /// As `nodelet unload` and `nodelet load` do.
  void restartNodelet(const std::string& name, const std::string& type) const {
    nodelet::NodeletUnload unload;
    unload.request.name = "/cocalib/" + name;
    ASSERT_TRUE(ros::service::call("/cocalib/manager/unload_nodelet", unload) && unload.response.success) << name;
    nodelet::NodeletLoad load;
    load.request.name = "/cocalib/" + name;
    load.request.type = "cocalib/" + type;
    ASSERT_TRUE(ros::service::call("/cocalib/manager/load_nodelet", load) && load.response.success) << name;
  }
  CalibrationEstimateMsg estimate() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return estimate_;
  }
  void forgetEstimate() {
    const std::lock_guard<std::mutex> lock(mutex_);
    estimate_ = CalibrationEstimateMsg();
  }
  bool bothKnown() {
    const CalibrationEstimateMsg now = estimate();
    return now.camera.valid && now.lidar.valid;
  }
  double seconds() { return (estimate().header.stamp - ros::Time(1.7e9)).toSec(); }
  /// A small picture and a quarter of a minute: far from the best, but a wrong sign or frame would be decimetres off.
  void expectNearTruth(const CalibrationEstimateMsg& msg) const {
    const Calibration calibration = fromEstimateMsg(msg).calibration;
    const Vector6d camera = calibration.T_imu_camera.minus(poseOf(truth_["camera"]["T_imu_camera"]));
    const Vector6d lidar = calibration.T_imu_lidar.minus(poseOf(truth_["lidar"]["T_imu_lidar"]));
    EXPECT_LT(camera.head<3>().norm(), 0.02);
    EXPECT_LT(camera.tail<3>().norm(), 0.01);
    EXPECT_LT(lidar.head<3>().norm(), 0.02);
    EXPECT_LT(lidar.tail<3>().norm(), 0.01);
  }
  /// The first message on a topic, for one who subscribes now.
  template <typename Msg>
  boost::shared_ptr<const Msg> lateOn(const std::string& topic) {
    return ros::topic::waitForMessage<Msg>("/cocalib/" + topic, nh_, ros::Duration(5.0 / pace()));
  }

  ros::NodeHandle nh_;
  std::string rig_, bag_;

 private:
  void onEstimate(const CalibrationEstimateMsg& msg) {
    const std::lock_guard<std::mutex> lock(mutex_);
    estimate_ = msg;
  }

  std::mutex mutex_;
  CalibrationEstimateMsg estimate_;
  ros::Subscriber subscriber_;
  ros::AsyncSpinner spinner_;
  fs::path directory_;
  YAML::Node truth_;
};

TEST_F(GoingOn, ThroughRestartsAndLoops) {
  simulate();
  {
    SCOPED_TRACE("each calibrator restarted while the fuser goes on");
    Program player(playerOf(rig_, bag_));
    ASSERT_TRUE(waitFor([&] { return bothKnown(); }, 30.0));
    restartNodelet("lidar_inertial", "LidarInertialCalibrator");
    restartNodelet("visual_inertial", "VisualInertialCalibrator");
    const double restarted_s = seconds();
    ASSERT_EQ(player.wait(), 0);  // it had all of them finish, and the result written
    EXPECT_GT(seconds(), restarted_s + 10.0);
    ASSERT_TRUE(bothKnown());
    expectNearTruth(estimate());
  }
  {
    SCOPED_TRACE("viewers that come when all is over");
    const auto late = lateOn<CalibrationEstimateMsg>("estimate");
    ASSERT_TRUE(late);
    EXPECT_EQ(late->header.stamp, estimate().header.stamp);
    EXPECT_TRUE(late->camera.valid);
    EXPECT_TRUE(lateOn<ExtrinsicEstimate>("visual_inertial/estimate"));
    EXPECT_TRUE(lateOn<ExtrinsicEstimate>("lidar_inertial/estimate"));
    const auto convergence = lateOn<sensor_msgs::Image>("convergence");
    EXPECT_TRUE(convergence && convergence->width > 0);
    const auto overlay = lateOn<sensor_msgs::Image>("overlay");
    EXPECT_TRUE(overlay && overlay->width == 376);
    const auto map = lateOn<sensor_msgs::PointCloud2>("lidar_inertial/map");
    EXPECT_TRUE(map && map->width > 1000);
    const auto markers = lateOn<visualization_msgs::MarkerArray>("markers");
    ASSERT_TRUE(markers);
    std::set<std::string> names;
    for (const visualization_msgs::Marker& marker : markers->markers) names.insert(marker.ns);
    EXPECT_EQ(names.count("status") + names.count("camera axes") + names.count("lidar axes"), 3U);
  }
  {
    SCOPED_TRACE("the fuser restarted, and the recording in a loop: every pass is a run of its own");
    restartNodelet("fuser", "CoCalibrationFuser");
    forgetEstimate();  // the new one has said nothing yet
    Program player("rosbag play --quiet --loop --duration 15 --rate " + std::to_string(pace()) + " " + bag_ +
                   " < /dev/null");
    ASSERT_TRUE(waitFor(
        [] {
          std_srvs::Trigger trigger;
          return ros::service::call("/cocalib/start", trigger) && trigger.response.success;
        },
        10.0));
    for (int pass = 0; pass < 3; ++pass) {
      ASSERT_TRUE(waitFor([&] { return bothKnown() && seconds() > 13.0; }, 20.0))
          << pass << ": " << estimate().progress;
      expectNearTruth(estimate());
      EXPECT_LT(estimate().duration, 16.0) << pass;
      ASSERT_TRUE(waitFor([&] { return !bothKnown(); }, 10.0)) << pass;
    }
  }
}

}  // namespace
}  // namespace cocalib

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "going_on");
  return RUN_ALL_TESTS();
}
