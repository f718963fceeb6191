#include "cocalib/estimation/track_noise.h"

#include <algorithm>
#include <cmath>

namespace cocalib {
namespace {

// Patches on slanted surfaces bend, beyond any affine warp, as the camera nears them: outwards by hundredths of a
// pixel, and alike all over a room. What tracks share does not average out, so none counts as better than this.
constexpr double kMinSigma_px = 0.1, kMaxSigma_px = 5.0;
// Drift so fast that hardly anything is white would make neighbouring observations one and the same number.
constexpr double kMaxDrift_per_s = 200.0;

}  // namespace

Eigen::MatrixXd TrackNoise::information(const std::vector<double>& times_s) const {
  const auto n = static_cast<Eigen::Index>(times_s.size());
  if (drift_per_s <= 0.0) return Eigen::MatrixXd::Identity(n, n);
  // The steps from one observation to the next (from zero to the first one) have a covariance M that is tridiagonal:
  // 2 + the drift between them on its diagonal (1 in the first place), -1 beside it.
  const auto drift = [&](Eigen::Index k) {
    const auto i = static_cast<std::size_t>(k);
    return drift_per_s * (k == 0 ? times_s[i] : times_s[i] - times_s[i - 1]);
  };
  Eigen::MatrixXd P(n, n);  // M^-1; the pivots of M stand on its diagonal first
  for (Eigen::Index k = 0; k < n; ++k) P(k, k) = (k == 0 ? 1.0 : 2.0 - 1.0 / P(k - 1, k - 1)) + drift(k);
  for (Eigen::Index k = n - 1; k >= 0; --k) {
    const double inverse = 1.0 / P(k, k);
    P(k, k) = k + 1 < n ? inverse + inverse * inverse * P(k + 1, k + 1) : inverse;
    for (Eigen::Index j = k + 1; j < n; ++j) P(j, k) = inverse * P(j, k + 1);
  }
  // Observations in place of steps, in the lower triangle, in the order in which nothing is needed again.
  for (Eigen::Index j = 0; j < n; ++j) {
    for (Eigen::Index i = j; i < n; ++i) {
      const double below = i + 1 < n ? P(i + 1, j) : 0.0;
      const double right = j + 1 < n ? (i == j ? below : P(i, j + 1)) : 0.0;
      const double both = i + 1 < n ? P(i + 1, j + 1) : 0.0;
      P(i, j) += both - below - right;
      P(j, i) = P(i, j);
    }
  }
  return P;
}

void TrackNoiseEstimator::add(const std::vector<double>& times_s, const std::vector<std::size_t>& places,
                              const std::vector<Eigen::Vector2d>& residuals_px, double weight) {
  ++tracks_;
  for (std::size_t i = 1; i < places.size(); ++i) {
    if (places[i] >= places_.size()) places_.resize(places[i] + 1);
    const Eigen::Vector2d step = weight * (residuals_px[i] - residuals_px[i - 1]);
    places_[places[i]].sum += step;
    places_[places[i]].squares += step.squaredNorm();
  }
  const auto compare = [&](std::size_t lag, Differences* out) {
    for (std::size_t i = 0; i + lag < times_s.size(); ++i) {
      out->squares += 0.5 * weight * (residuals_px[i + lag] - residuals_px[i]).squaredNorm();
      out->seconds += weight * (times_s[i + lag] - times_s[i]);
      out->weight += weight;
    }
  };
  compare(1, &near_);
  compare(kFar, &far_);
}

void TrackNoiseEstimator::addWhitened(double squared, double expected, double weight) {
  squared_ += weight * squared;
  expected_ += expected;
}

TrackNoise TrackNoiseEstimator::estimate(const TrackNoise& in_use) const {
  TrackNoise out = in_use;
  if (near_.weight > 0.0 && far_.weight > 0.0) {
    // E |r_j - r_i|^2 per axis = 2 sigma^2 + sigma^2 drift (t_j - t_i)
    const double slope = std::max(0.0, (far_.mean() - near_.mean()) / (far_.span() - near_.span()));
    const double white = 0.5 * (near_.mean() - slope * near_.span());
    out.drift_per_s = slope > 0.0 ? slope / std::max(white, slope / kMaxDrift_per_s) : 0.0;
  }
  // The size follows from all residuals together, and so holds whatever the differences miss.
  if (expected_ > 0.0) {
    const double own_px = in_use.sigma_px * std::sqrt(squared_ / expected_);
    out.sigma_px = std::clamp(own_px * std::sqrt(designEffect()), kMinSigma_px, kMaxSigma_px);
  }
  return out;
}

double TrackNoiseEstimator::designEffect() const {
  double together = 0.0, apart = 0.0;
  for (const Place& place : places_) {
    together += place.sum.squaredNorm();
    apart += place.squares;
  }
  return apart > 0.0 ? std::max(1.0, together / apart) : 1.0;
}

}  // namespace cocalib
