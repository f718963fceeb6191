#include "cocalib/calibrators/window_record.h"

#include <algorithm>

namespace cocalib {
namespace {

// How much longer than its length the record may grow before it is shortened: a round over all of it is dear.
constexpr double kOverhang = 1.2;
constexpr int kShortenIterations = 2;  // the states are good; the rest waits for the last round
constexpr int kFirstIterations = 2;    // for better planes: what the last round starts from
constexpr std::size_t kFirstPoints = 3000;
constexpr int kLastIterations = 10;
constexpr double kStartSlack_m = 0.005;

}  // namespace

void WindowRecord::take(const InertialWindow& live, TimeNs until) {
  const std::vector<NavState>& nodes = live.state().nodes;
  const auto newer = [&](const NavState& node) { return !started_ || node.stamp > window_.state().nodes.back().stamp; };
  for (const ImuSample& sample : live.imu().samples()) {
    if (sample.stamp > until + toNs(0.1)) break;
    if (window_.imu().empty() || sample.stamp > window_.imu().lastStamp()) window_.imu().push(sample);
  }
  for (const NavState& node : nodes) {
    if (node.stamp >= until) break;
    if (!newer(node)) continue;
    if (!started_) {
      window_.reset(node, live.state().calibration, live.state().gravity);
      started_ = true;
    } else {
      window_.addNode(node);
    }
  }
  if (!started_) return;
  takeMeasurements();
  window_.adopt(live);
  const std::vector<NavState>& own = window_.state().nodes;
  if (toSeconds(own.back().stamp - own.front().stamp) > kOverhang * length_s_) shorten(live.state().calibration);
}

void WindowRecord::takeMeasurements() {
  const Calibration& c = window_.state().calibration;
  const TimeNs begin = window_.state().nodes.front().stamp, end = window_.state().nodes.back().stamp;
  for (; !frames_.empty(); frames_.pop_front()) {
    const TimeNs stamp = frames_.front().stamp + toNs(c.camera_time_offset_s);
    if (stamp > end) break;
    if (stamp >= begin) window_.addFrame(frames_.front());
  }
  for (; !scans_.empty(); scans_.pop_front()) {
    const LidarScan& scan = *scans_.front();
    const TimeNs stamp = scan.stamp + toNs(c.lidar_time_offset_s);
    if (stamp + toNs(scan.points.back().offset_s) > end) break;
    if (stamp >= begin) window_.addScan(scans_.front());
  }
}

bool WindowRecord::solveRound(Relink what, double slack_m, int iterations, std::size_t points) {
  window_.relink(what, slack_m, points);
  if (window_.optimize(iterations).failed) {
    ++failed_solves_;
    return false;
  }
  window_.learnNoise();
  return true;
}

/// Turns the oldest part into a prior, about states and calibration that fit all of the record.
void WindowRecord::shorten(const Calibration& start) {
  window_.setLinearization(start);
  solveRound(window_.neededRelink(), kStartSlack_m, kShortenIterations, LidarGroup::kAllPoints);
  const TimeNs oldest = window_.state().nodes.back().stamp - toNs(length_s_);
  if (!window_.marginalizeBefore(oldest)) ++failed_solves_;
}

bool WindowRecord::solve(const Calibration& start, const std::function<void(double)>& progress) {
  if (!started_ || window_.state().nodes.size() < 2) return false;
  window_.setLinearization(start);
  if (progress) progress(0.0);
  solveRound(Relink::kNewPlanes, kStartSlack_m, kFirstIterations, kFirstPoints);
  if (progress) progress(0.4);
  const bool solved = solveRound(Relink::kAllScans, 0.0, kLastIterations, LidarGroup::kAllPoints);
  if (progress) progress(1.0);
  return solved;
}

void WindowRecord::reset() {
  window_.imu().clear();
  frames_.clear();
  scans_.clear();
  started_ = false;
}

}  // namespace cocalib
