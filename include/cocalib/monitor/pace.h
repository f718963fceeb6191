#pragma once

#include <optional>
#include <string>

#include "cocalib/measurements/finding.h"

namespace cocalib {

/// How much of a stream is used, so that the work on it keeps up with the data on a machine that is too slow for all of
/// it. Once a second the share falls where all data had to wait, and rises slowly where some had not: a backlog is
/// worked off with fewer data instead of growing. Not thread-safe.
class Pace {
 public:
  /// @param long_s  a wait that is too long
  explicit Pace(double long_s = 0.25) : long_s_(long_s) {}

  /// Every message of the stream, as its turn comes. @param now_s  on a steady clock @param waited_s  since it came
  /// @return whether it is to be used at all: once a machine is known as too slow, what waited for almost a second is
  /// not
  bool take(double now_s, double waited_s);

  /// Of the usual amount of data, kLeast..1.
  double share() const { return share_; }
  /// For so long that the user should know of it.
  bool tooSlow() const { return too_slow_; }

  static constexpr double kLeast = 0.25;  // pictures further apart are not followed any more

 private:
  double long_s_;
  double share_ = 1.0;
  bool too_slow_ = false;
  std::optional<double> judged_s_;
  double shortest_s_ = 0.0;  // wait since then
};

/// What the user reads where `part` ("camera", "lidar", "fuser") cannot keep up.
Finding tooSlow(const std::string& part);

}  // namespace cocalib
