#pragma once

#include <optional>

#include "cocalib/geometry/time.h"
#include "cocalib/measurements/stamp_order.h"

namespace cocalib {

/// Watches the stamps of the IMU, the one stream that every pipeline has, for a clock that was set back (a bag that
/// loops): everything must start over then. Pictures, sweeps and keyframes that are still on their way from before the
/// start-over are recognised by their distance to the IMU. Not thread-safe.
class StreamGuard {
 public:
  enum class Verdict { kGood, kDrop, kRestart };

  /// kDrop: repeated, a little back, or alone far away. kRestart: set back by more than a second, as two samples say;
  /// this one is the first of the new run.
  Verdict onImu(TimeNs stamp);

  /// Whether data of this time belong to the present run.
  bool accepts(TimeNs stamp) const;

  void reset() {
    first_.reset();
    order_.reset();
  }

 private:
  std::optional<TimeNs> first_;
  StampOrder order_;
};

}  // namespace cocalib
