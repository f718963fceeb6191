/// A machine that is too slow: the nodelets must say so, stay with the present, and still find the mountings.

#include <diagnostic_msgs/DiagnosticArray.h>
#include <gtest/gtest.h>
#include <ros/master.h>
#include <ros/network.h>
#include <ros/package.h>
#include <ros/ros.h>
#include <sched.h>
#include <std_srvs/Trigger.h>
#include <unistd.h>
#include <xmlrpcpp/XmlRpc.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <mutex>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "cocalib/io/result_file.h"
#include "live_test.h"

namespace cocalib {
namespace {

using test::pace;
using test::playerOf;
using test::poseOf;
using test::Program;
using test::runCommand;
using test::waitFor;

namespace fs = std::filesystem;

pid_t pidOf(const std::string& node) {
  XmlRpc::XmlRpcValue request, response, payload;
  request[0] = ros::this_node::getName();
  request[1] = node;
  if (!ros::master::execute("lookupNode", request, response, payload, false)) return 0;
  std::string host;
  std::uint32_t port = 0;
  if (!ros::network::splitURI(std::string(payload), host, port)) return 0;
  XmlRpc::XmlRpcClient client(host.c_str(), static_cast<int>(port));
  request.setSize(1);
  if (!client.execute("getPid", request, response)) return 0;
  return static_cast<int>(response[2]);
}

/// Lets every thread of a process run on these processors only.
void pin(pid_t pid, const cpu_set_t& processors) {
  for (const fs::directory_entry& task : fs::directory_iterator("/proc/" + std::to_string(pid) + "/task"))
    sched_setaffinity(std::stoi(task.path().filename().string()), sizeof processors, &processors);
}

/// Of all threads of a process since it began [s].
double processorTime(pid_t pid) {
  double total_s = 0.0;
  for (const fs::directory_entry& task : fs::directory_iterator("/proc/" + std::to_string(pid) + "/task")) {
    double run_ns = 0.0;
    std::ifstream(task.path() / "schedstat") >> run_ns;
    total_s += 1e-9 * run_ns;
  }
  return total_s;
}

/// Lets a process run on one processor, and use a share of its time only, as a slower machine would. What other
/// processes take of that processor is not counted against it.
class Brake {
 public:
  Brake(pid_t pid, double share) : pid_(pid) {
    sched_getaffinity(pid, sizeof usual_, &usual_);
    cpu_set_t one;
    CPU_ZERO(&one);
    CPU_SET(sched_getcpu(), &one);
    pin(pid, one);
    thread_ = std::thread([this, share] { run(share); });
  }
  ~Brake() { release(); }
  void release() {
    if (ended_.exchange(true)) return;
    thread_.join();
    pin(pid_, usual_);
  }

 private:
  void run(double share) {
    constexpr double kStep_s = 0.01, kMostSaved_s = 0.05;
    double used_s = processorTime(pid_), left_s = 0.0;
    ros::WallTime last = ros::WallTime::now();
    while (!ended_) {
      ros::WallDuration(kStep_s).sleep();
      const ros::WallTime now = ros::WallTime::now();
      const double use_s = processorTime(pid_);
      left_s = std::min(left_s + share * (now - last).toSec() - (use_s - used_s), share * kMostSaved_s);
      used_s = use_s;
      last = now;
      kill(pid_, left_s > 0.0 ? SIGCONT : SIGSTOP);
    }
    kill(pid_, SIGCONT);
  }

  const pid_t pid_;
  cpu_set_t usual_;
  std::atomic<bool> ended_{false};
  std::thread thread_;
};

/// What the two calibrators say in /diagnostics.
class Listener {
 public:
  Listener() { subscriber_ = nh_.subscribe("/diagnostics", 100, &Listener::onDiagnostics, this); }

  bool saidTooSlow() const { return too_slow_; }
  /// What data had to wait since the last call [s].
  std::vector<double> takeWaits() {
    const std::lock_guard<std::mutex> lock(mutex_);
    return std::exchange(waits_s_, {});
  }

 private:
  void onDiagnostics(const diagnostic_msgs::DiagnosticArray& msg) {
    for (const auto& status : msg.status) {
      for (const auto& entry : status.values) {
        if (entry.value.rfind("too slow: ", 0) == 0) too_slow_ = status.level == status.WARN;
        if (entry.key != "wait of the data [s]") continue;
        const std::lock_guard<std::mutex> lock(mutex_);
        waits_s_.push_back(std::stod(entry.value));
      }
    }
  }

  ros::NodeHandle nh_;
  std::mutex mutex_;
  std::vector<double> waits_s_;
  std::atomic<bool> too_slow_{false};
  ros::Subscriber subscriber_;
};

/// Of one sensor's mounting, with what the result says of itself.
struct Error {
  double m, rad, sigma_m, sigma_rad;
};

class TooSlow : public testing::Test {
 protected:
  TooSlow() : spinner_(1), directory_(fs::temp_directory_path() / ("cocalib_too_slow_" + std::to_string(getpid()))) {
    ros::NodeHandle own("~");
    own.getParam("rig", rig_);
    own.getParam("output", output_);
    spinner_.start();
    fs::create_directories(directory_);
    bag_ = (directory_ / "in.bag").string();
  }
  ~TooSlow() override { fs::remove_all(directory_); }

  /// Of camera and lidar in the result that was written last.
  std::array<Error, 2> errors() const {
    const YAML::Node truth = YAML::LoadFile((directory_ / "in.truth.yaml").string());
    const CalibrationEstimate result = loadResult(output_ + "/calibration.yaml");
    EXPECT_TRUE(result.camera.valid && result.lidar.valid) << result.message;
    const auto error = [](const Pose& found, const YAML::Node& right, const Vector6d& sigma) {
      const Vector6d off = found.minus(poseOf(right));
      return Error{off.head<3>().norm(), off.tail<3>().norm(), sigma.head<3>().norm(), sigma.tail<3>().norm()};
    };
    return {error(result.calibration.T_imu_camera, truth["camera"]["T_imu_camera"], result.camera.sigma),
            error(result.calibration.T_imu_lidar, truth["lidar"]["T_imu_lidar"], result.lidar.sigma)};
  }

  std::string rig_, output_, bag_;
  Listener listener_;

 private:
  ros::AsyncSpinner spinner_;
  fs::path directory_;
};

TEST_F(TooSlow, UsesFewerDataAndSaysSo) {
  ASSERT_EQ(runCommand("rosrun cocalib simulate --scenario " + ros::package::getPath("cocalib") +
                       "/test/ros/launch_scenario.yaml --duration 40 --bag " + bag_ + " --seed 3"),
            0);
  const pid_t manager = pidOf("/cocalib/manager");
  ASSERT_GT(manager, 0);
  const double before_s = processorTime(manager);
  const ros::WallTime began = ros::WallTime::now();
  ASSERT_EQ(runCommand(playerOf(rig_, bag_)), 0);
  const double load = (processorTime(manager) - before_s) / (ros::WallTime::now() - began).toSec();
  const std::array<Error, 2> usual = errors();

  std_srvs::Trigger start;
  ASSERT_TRUE(ros::service::call("/cocalib/start", start) && start.response.success);
  {
    Brake brake(manager, 0.5 * load);
    Program player(playerOf(rig_, bag_));
    EXPECT_TRUE(waitFor([&] { return listener_.saidTooSlow(); }, 20.0));
    waitFor([] { return false; }, 4.0);  // the backlog from before
    listener_.takeWaits();
    waitFor([] { return false; }, 10.0);
    std::vector<double> waits_s = listener_.takeWaits();
    ASSERT_GT(waits_s.size(), 5U);
    std::sort(waits_s.begin(), waits_s.end());
    std::printf("it needs %.2f processors and had %.2f: waits of %.2f s (median), %.2f s (longest)\n", load, 0.5 * load,
                waits_s[waits_s.size() / 2], waits_s.back());
    EXPECT_GT(waits_s.back(), 0.0);
    EXPECT_LT(waits_s.front(), 1.0 / pace()) << "the backlog grows";
    brake.release();
    ASSERT_EQ(player.wait(), 0);
  }
  const std::array<Error, 2> slow = errors();
  for (std::size_t i = 0; i < usual.size(); ++i) {
    std::printf("%s: %.2f -> %.2f mm, %.3f -> %.3f mrad\n", i == 0 ? "camera" : "lidar", 1e3 * usual[i].m,
                1e3 * slow[i].m, 1e3 * usual[i].rad, 1e3 * slow[i].rad);
    // One recording may have been lucky.
    EXPECT_LE(slow[i].m, 3.0 * std::max(usual[i].m, usual[i].sigma_m));
    EXPECT_LE(slow[i].rad, 3.0 * std::max(usual[i].rad, usual[i].sigma_rad));
  }
}

}  // namespace
}  // namespace cocalib

int main(int argc, char** argv) {
  testing::InitGoogleTest(&argc, argv);
  ros::init(argc, argv, "too_slow");
  return RUN_ALL_TESTS();
}
