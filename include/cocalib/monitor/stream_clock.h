#pragma once

#include <cstddef>
#include <deque>

#include "cocalib/geometry/time.h"

namespace cocalib {

/// The stamps of one stream, watched: how often, how regular, how far from the clock of those who receive it. Looks at
/// the newest messages only. Not thread-safe. Deterministic.
class StreamClock {
 public:
  /// @param keep  messages looked at
  explicit StreamClock(std::size_t keep) : keep_(keep) {}

  /// @param received  on a clock common to all streams: the host's, or the time of recording
  void add(TimeNs stamp, TimeNs received);
  std::size_t count() const { return count_; }
  /// By how much the stamps have jumped ahead of the time of reception, for good, as when a clock is set; the last such
  /// jump, 0 if there was none [s]. Back is negative. What came before a jump is not looked at any more.
  double jump_s() const { return jump_s_; }

  /// What the newest messages show; meaningful from some ten messages on.
  struct Summary {
    double period_s = 0.0;      ///< typical time between two stamps that grow
    double jitter_s = 0.0;      ///< 90 % of the intervals are within this of a multiple of the period
    double lost_share = 0.0;    ///< of the messages that should be there
    double repeated_share = 0;  ///< of the stamps that do not grow
    double lag_s = 0.0;         ///< median of received minus stamp
    double rate_hz() const { return period_s > 0.0 ? 1.0 / period_s : 0.0; }
  };
  Summary summary() const;

 private:
  struct Arrival {
    TimeNs stamp, received;
    double lag_s() const { return toSeconds(received - stamp); }
  };
  void noteJump();

  std::size_t keep_, count_ = 0;
  double jump_s_ = 0.0;
  std::deque<Arrival> newest_;
};

}  // namespace cocalib
