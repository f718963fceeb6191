#pragma once

#include <cmath>

namespace cocalib {

/// Weight of a residual in iteratively re-weighted least squares, and its share of the cost.
struct RobustWeight {
  double weight;
  double cost;
};

/// Student's t of a whole vector of residuals with one scale of its own, known beforehand only as well as from
/// `freedom` residuals: a vector of `degrees` degrees that is just as large as expected counts in full, one far larger
/// hardly.
inline RobustWeight studentT(double squared, double degrees, double freedom) {
  return {(freedom + degrees) / (freedom + squared), 0.5 * (freedom + degrees) * std::log1p(squared / freedom)};
}

/// Huber's loss of a squared whitened residual: quadratic up to `limit` sigmas, linear beyond.
inline RobustWeight huber(double squared, double limit) {
  if (squared <= limit * limit) return {1.0, 0.5 * squared};
  const double norm = std::sqrt(squared);
  return {limit / norm, limit * (norm - 0.5 * limit)};
}

}  // namespace cocalib
