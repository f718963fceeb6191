#pragma once

#include <deque>
#include <functional>
#include <memory>

#include "cocalib/estimation/inertial_window.h"

namespace cocalib {

/// All that a short window has seen, for one estimate over everything: nodes come with the states that they had when
/// they left the short window, so a few iterations are enough. What is older than its length becomes a prior.
class WindowRecord {
 public:
  WindowRecord(const InertialWindow::Params& params, double length_s) : window_(params), length_s_(length_s) {}

  void setTranslationPriors(double camera_m, double lidar_m) { window_.setTranslationPriors(camera_m, lidar_m); }
  /// Measurements that the short window was given; they wait here for their nodes.
  void keep(const VisualKeyframe& keyframe) { frames_.push_back(keyframe); }
  void keep(std::shared_ptr<const LidarScan> scan) { scans_.push_back(std::move(scan)); }

  /// Takes over the nodes of `live` before `until` that it does not have yet, with their inertial data, and the
  /// measurements between them. To be called before `live` forgets them.
  void take(const InertialWindow& live, TimeNs until);

  /// Solves for everything. @param progress called with 0..1; may be empty. @return false if there is too little, or no
  /// step made it better: its state is worth nothing then
  bool solve(const Calibration& start, const std::function<void(double)>& progress);

  const InertialWindow& window() const { return window_; }
  InertialWindow& window() { return window_; }
  std::size_t failedSolves() const { return failed_solves_; }
  void reset();

 private:
  void takeMeasurements();
  bool solveRound(Relink what, double slack_m, int iterations, std::size_t points);
  void shorten(const Calibration& start);

  InertialWindow window_;
  double length_s_;
  std::deque<VisualKeyframe> frames_;
  std::deque<std::shared_ptr<const LidarScan>> scans_;
  bool started_ = false;
  std::size_t failed_solves_ = 0;
};

}  // namespace cocalib
