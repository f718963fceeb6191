#pragma once

#include <cstdint>
#include <map>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "cocalib/calibrators/diagnostics.h"

namespace cocalib {

/// A line for the user.
struct Notice {
  std::string text;
  bool warning = true;  ///< otherwise only for information
};

/// What a pipeline has to tell the user: counters for diagnostics, and lines to be said once each. Not thread-safe.
class Notices {
 public:
  /// Counts an event, e.g. "images refused".
  void count(const std::string& what) { ++counts_[what]; }

  /// Queues a line unless it was queued before; after 32 different ones no more are taken (a broken driver can make
  /// every message differ).
  void warn(const std::string& text) { say({text, true}); }
  void inform(const std::string& text) { say({text, false}); }

  /// Lines that have not been taken yet.
  std::vector<Notice> take() { return std::exchange(fresh_, {}); }
  const std::map<std::string, std::uint64_t>& counts() const { return counts_; }
  /// A calibrator's words and counters together with these.
  CalibratorDiagnostics addTo(CalibratorDiagnostics diagnostics) const {
    for (const auto& [what, number] : counts_) diagnostics.counts[what] = number;
    return diagnostics;
  }
  std::uint64_t counted(const std::string& what) const {
    const auto found = counts_.find(what);
    return found == counts_.end() ? 0 : found->second;
  }

 private:
  void say(Notice notice) {
    constexpr std::size_t kMostLines = 32;
    if (said_.size() < kMostLines && said_.insert(notice.text).second) fresh_.push_back(std::move(notice));
  }

  std::map<std::string, std::uint64_t> counts_;
  std::set<std::string> said_;
  std::vector<Notice> fresh_;
};

}  // namespace cocalib
