#pragma once

#include <ros/time.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>
#include <yaml-cpp/yaml.h>

#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

#include "cocalib/geometry/pose.h"

// What the tests with a master share.
namespace cocalib::test {

/// A transform of a result file or of the truth beside a recording.
inline Pose poseOf(const YAML::Node& node) {
  const auto t = node["translation"].as<std::vector<double>>();
  const auto q = node["rotation_xyzw"].as<std::vector<double>>();
  return {Eigen::Quaterniond(q[3], q[0], q[1], q[2]).normalized(), {t[0], t[1], t[2]}};
}

/// Exit status of a command; -1: it was killed.
inline int runCommand(const std::string& command) {
  const int status = std::system(command.c_str());
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

/// Share of its own pace at which a recording is played: builds that sanitizers have made slow need ten times their
/// time.
inline double pace() {
  const char* given = std::getenv("COCALIB_TEST_PACE");
  return given != nullptr ? std::stod(given) : 1.0;
}

/// Whether the condition came true within so many seconds of a recording that is played at pace().
inline bool waitFor(const std::function<bool()>& condition, double seconds) {
  const ros::WallTime end = ros::WallTime::now() + ros::WallDuration(seconds / pace());
  while (!condition() && ros::WallTime::now() < end) ros::WallDuration(0.05).sleep();
  return condition();
}

/// Shell command that plays a recording to the nodelets, and has them finish.
inline std::string playerOf(const std::string& rig, const std::string& bag) {
  return "ROS_NAMESPACE=/cocalib rosrun cocalib play_bag --rig " + rig + " --bag " + bag + " --rate " +
         std::to_string(pace());
}

/// A program that runs beside the test, and is ended with it.
class Program {
 public:
  explicit Program(const std::string& command) : pid_(fork()) {
    if (pid_ != 0) return;
    setpgid(0, 0);  // so that what the shell starts is ended with it
    execl("/bin/sh", "sh", "-c", command.c_str(), nullptr);
    _exit(127);
  }
  ~Program() { end(); }
  Program(const Program&) = delete;
  Program& operator=(const Program&) = delete;

  int wait() {
    int status = 0;
    if (pid_ > 0) waitpid(pid_, &status, 0);
    pid_ = 0;
    return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  }
  void end() {
    if (pid_ <= 0) return;
    kill(-pid_, SIGINT);
    wait();
  }

 private:
  pid_t pid_;
};

}  // namespace cocalib::test
