#include "cocalib/ros/diagnostics_publisher.h"

#include <diagnostic_msgs/DiagnosticStatus.h>

#include <algorithm>
#include <utility>

namespace cocalib {
namespace {

bool isTrouble(const std::string& counter) {
  for (const char* word : {"dropped", "refused", "failed"}) {
    // Points out of range are everyday; they do not make a warning.
    if (counter.find(word) != std::string::npos && counter.find("points") == std::string::npos) return true;
  }
  return false;
}

}  // namespace

DiagnosticsPublisher::DiagnosticsPublisher(const ros::NodeHandle& nh, const ros::NodeHandle& private_nh,
                                           const std::string& name)
    : updater_(nh, private_nh, "/" + name) {  // the updater cuts the first letter off, which it takes for a slash
  updater_.setHardwareID("none");
  updater_.add("calibration", this, &DiagnosticsPublisher::report);
  timer_ = ros::NodeHandle(nh).createWallTimer(ros::WallDuration(1.0),
                                               [this](const ros::WallTimerEvent&) { updater_.force_update(); });
}

void DiagnosticsPublisher::update(CalibratorDiagnostics diagnostics, const Values& values) {
  const std::lock_guard<std::mutex> lock(mutex_);
  diagnostics_ = std::move(diagnostics);
  if (std::exchange(reported_, false)) values_.clear();
  for (const auto& [what, value] : values) {
    const auto [known, fresh] = values_.emplace(what, value);
    if (!fresh) known->second = std::max(known->second, value);
  }
}

void DiagnosticsPublisher::report(diagnostic_updater::DiagnosticStatusWrapper& status) {
  const std::lock_guard<std::mutex> lock(mutex_);
  const ros::WallTime now = ros::WallTime::now();
  const double since_s = (now - last_report_).toSec();
  last_report_ = now;
  bool trouble = false;
  for (const auto& [what, number] : diagnostics_.counts) {
    const std::uint64_t before = last_counts_[what];
    const double rate_hz = number > before ? static_cast<double>(number - before) / since_s : 0.0;
    status.addf(what, "%llu (%.1f per s)", static_cast<unsigned long long>(number), rate_hz);
    trouble = trouble || (number > before && isTrouble(what));
  }
  last_counts_ = diagnostics_.counts;
  for (std::size_t i = 0; i < diagnostics_.findings.size(); ++i) {
    status.add("finding " + std::to_string(i + 1), diagnostics_.findings[i]);
  }
  trouble = trouble || !diagnostics_.findings.empty();
  reported_ = true;
  for (const auto& [what, value] : values_) status.addf(what, "%.4g", value);
  const std::string words = diagnostics_.stage + (diagnostics_.message.empty() ? "" : ": " + diagnostics_.message);
  using diagnostic_msgs::DiagnosticStatus;
  status.summary(trouble ? DiagnosticStatus::WARN : DiagnosticStatus::OK, words.empty() ? "starting" : words);
}

}  // namespace cocalib
