#include "cocalib/calibrators/window_health.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "cocalib/measurements/validity.h"

namespace cocalib {
namespace {

constexpr double kMinConsistent = 0.5;    // share of the track observations that the states explain
constexpr double kMinOnPlanes = 0.1;      // share of the lidar's points
constexpr double kNewest_s = 1.0;         // of sweeps: what is older has been judged before
constexpr double kMargin_s = 2.0;         // for clock offsets
constexpr double kLargestOffset_s = 0.1;  // between the clocks, up to which the start looks for the offset
constexpr double kMaxImuGap_s = 0.3;      // over which a person's motion can be guessed well enough to go on
constexpr std::size_t kFewPoints = 500;   // of which a share says nothing

}  // namespace

bool isPossible(const WindowState& state) {
  const Calibration& c = state.calibration;
  return isUsable(state.nodes.back()) && isUsable(c.T_imu_camera, c.camera_time_offset_s) &&
         isUsable(c.T_imu_lidar, c.lidar_time_offset_s);
}

bool explainsData(const InertialWindow& window) {
  if (!isPossible(window.state())) return false;
  if (const CameraGroup* camera = window.camera()) {
    if (camera->consistentShare() < kMinConsistent) return false;
  }
  const LidarGroup* lidar = window.lidar();
  if (lidar == nullptr || lidar->scans() == 0) return true;
  const int end = lidar->scans();
  int first = end - 1;
  std::size_t points = lidar->scan(first).points.size();
  while (first > 0 && toSeconds(lidar->scan(end - 1).stamp - lidar->scan(first - 1).stamp) < kNewest_s) {
    points += lidar->scan(--first).points.size();
  }
  return points < kFewPoints || lidar->shareOnPlanes(first, end) >= kMinOnPlanes;
}

std::string imuGap(const InertialWindow& window, TimeNs until) {
  if (window.imu().empty()) return "";
  const double gap_s =
      window.imu().longestGap(window.state().nodes.back().stamp, std::min(until, window.imu().lastStamp()));
  if (!std::isfinite(gap_s) || gap_s <= kMaxImuGap_s) return "";
  char words[64];
  std::snprintf(words, sizeof(words), "no inertial data for %.1f s", gap_s);
  return words;
}

std::string interruption(const InertialWindow& window, TimeNs until, double longest_s, const std::string& what) {
  if (toSeconds(until - window.state().nodes.back().stamp) > longest_s)
    return "no " + what + " for longer than the window";
  return imuGap(window, until);
}

TimeNs forgetUselessImu(TimeNs oldest, TimeNs newest, ImuBuffer* imu) {
  if (imu->empty()) return oldest;
  imu->forgetBefore(std::max(oldest - toNs(kMargin_s), imu->unbrokenSince(kMaxImuGap_s, newest)));
  return imu->firstStamp() + toNs(kLargestOffset_s);
}

void sayStartingOver(const std::string& reason, CalibrationEstimate* estimate, CalibratorDiagnostics* diagnostics) {
  ++diagnostics->counts["restarts after failure"];
  *estimate = CalibrationEstimate();
  diagnostics->stage = "starting over";
  diagnostics->message = estimate->message = "starting over: " + reason;
}

}  // namespace cocalib
