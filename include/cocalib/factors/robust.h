#pragma once

#include <cmath>

namespace cocalib {

/// Weight of a residual in iteratively re-weighted least squares, and its share of the cost.
struct RobustWeight {
  double weight;
  double cost;
};

/// Huber's loss of a squared whitened residual: quadratic up to `limit` sigmas, linear beyond.
inline RobustWeight huber(double squared, double limit) {
  if (squared <= limit * limit) return {1.0, 0.5 * squared};
  const double norm = std::sqrt(squared);
  return {limit / norm, limit * (norm - 0.5 * limit)};
}

}  // namespace cocalib
