#pragma once

#include <cmath>
#include <cstddef>

#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Whether element `index` of a series is among the share of it that is kept: spread evenly, and in step with no period
/// of the series (lasers come in powers of two), as multiples of the golden ratio are.
inline bool isKept(std::size_t index, double share) {
  constexpr double kGolden = 0.6180339887498949;
  const double turns = kGolden * static_cast<double>(index);
  return turns - std::floor(turns) < share;
}

/// Leaves a share of a sweep's points, 0..1, in their order.
inline void thin(LidarScan* scan, double share) {
  if (share >= 1.0) return;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < scan->points.size(); ++i) {
    if (isKept(i, share)) scan->points[kept++] = scan->points[i];
  }
  scan->points.resize(kept);
}

}  // namespace cocalib
