#pragma once

#include <optional>

#include "cocalib/geometry/time.h"

namespace cocalib {

/// Tells a stream of stamps that goes on from one stamp that is wrong. A stamp far from the one before is a clock that
/// was set, or a sensor that comes back, only when the next one follows it; until then it is one broken message, which
/// must not cost the calibration. Not thread-safe.
class StampOrder {
 public:
  enum class Verdict {
    kGood,     ///< the next one; also the second after a pause
    kDrop,     ///< repeated, a little back, or far away and not confirmed
    kSetBack,  ///< the clock was set back by more than a second: the second of the new stream
  };

  Verdict take(TimeNs stamp) {
    if (!last_ || follows(stamp, *last_)) return accept(stamp, Verdict::kGood);
    if (stamp <= *last_ && stamp > *last_ - kFarNs) return Verdict::kDrop;
    if (!suspect_ || !follows(stamp, *suspect_)) {
      suspect_ = stamp;
      return Verdict::kDrop;
    }
    return accept(stamp, stamp < *last_ ? Verdict::kSetBack : Verdict::kGood);
  }

  const std::optional<TimeNs>& last() const { return last_; }
  void reset() {
    last_.reset();
    suspect_.reset();
  }

 private:
  static constexpr TimeNs kFarNs = 1'000'000'000;

  static bool follows(TimeNs stamp, TimeNs before) { return stamp > before && stamp - before <= kFarNs; }
  Verdict accept(TimeNs stamp, Verdict verdict) {
    last_ = stamp;
    suspect_.reset();
    return verdict;
  }

  std::optional<TimeNs> last_, suspect_;
};

}  // namespace cocalib
