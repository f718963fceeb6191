#pragma once

#include <diagnostic_updater/diagnostic_updater.h>
#include <ros/node_handle.h>
#include <ros/wall_timer.h>

#include <cstdint>
#include <map>
#include <mutex>
#include <string>

#include "cocalib/calibrators/diagnostics.h"

namespace cocalib {

/// Puts a calibrator's words and counters, with their rates, on /diagnostics once a second of wall time (simulated time
/// may stand still). Every counter whose name contains "dropped", "refused" or "failed" and grows makes it a warning.
class DiagnosticsPublisher {
 public:
  /// What a nodelet adds to its calibrator's counters: queues, latency. The largest since the last report is shown.
  using Values = std::map<std::string, double>;

  DiagnosticsPublisher(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh, const std::string& name);

  /// Newest state; from any thread.
  void update(CalibratorDiagnostics diagnostics, const Values& values);

 private:
  void report(diagnostic_updater::DiagnosticStatusWrapper& status);

  std::mutex mutex_;
  CalibratorDiagnostics diagnostics_;
  Values values_;
  bool reported_ = true;  // and nothing new since
  std::map<std::string, std::uint64_t> last_counts_;
  ros::WallTime last_report_;
  diagnostic_updater::Updater updater_;
  ros::WallTimer timer_;  // last: it uses all of the above
};

}  // namespace cocalib
