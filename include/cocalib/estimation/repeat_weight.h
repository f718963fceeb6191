#pragma once

#include "cocalib/geometry/pose.h"

namespace cocalib {

/// What a measurement of one sensor counts, beside those taken before it.
///
/// A rig that stands measures the same thing again and again, together with all that is wrong with it: a beam ends
/// beside an edge in the same place, a corner lies between the same pixels, a feature is compared with the same first
/// picture. Errors that repeat do not average out, and half a minute of them would count for more than all of the
/// motion before. So of the measurements from one place the n-th counts 1/n: an hour at rest for as much as one second.
class RepeatWeight {
 public:
  /// @param T_W_S  where the next measurement was taken from: the sensor's pose
  /// @return 0..1; 1 where the sensor has moved since the one that was the first at its place
  double next(const Pose& T_W_S) {
    constexpr double kSamePlace_m = 0.005, kSameDirection_rad = 0.002;  // half a pixel, or half the step between beams
    const Vector6d moved = T_W_S.minus(first_);
    const bool same =
        count_ > 0 && moved.head<3>().norm() < kSamePlace_m && moved.tail<3>().norm() < kSameDirection_rad;
    if (!same) {
      first_ = T_W_S;
      count_ = 0;
    }
    return 1.0 / ++count_;
  }

 private:
  Pose first_;  ///< of those from the same place
  int count_ = 0;
};

}  // namespace cocalib
