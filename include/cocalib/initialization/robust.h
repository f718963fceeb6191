#pragma once

#include <algorithm>
#include <vector>

namespace cocalib {

/// Median (upper one of an even number); 0 of nothing.
inline double medianOf(std::vector<double> values) {
  if (values.empty()) return 0.0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Median length of a Gaussian vector with 1 sigma per axis, by dimension: what turns a median into a sigma.
constexpr double kMedianLength1 = 0.6745, kMedianLength2 = 1.1774, kMedianLength3 = 1.5382;

/// Weight of a residual of `length` under Cauchy's loss of the given scale.
inline double cauchyWeight(double length, double scale) { return 1.0 / (1.0 + (length / scale) * (length / scale)); }

}  // namespace cocalib
