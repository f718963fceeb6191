#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <vector>

namespace cocalib {

/// Noise of a track that is followed from picture to picture: every observation has an error of its own (white), and
/// the error that the steps have added up since the first one (a random walk). Observations at times t_i, t_j after the
/// first then have the covariance sigma^2 (delta_ij + drift min(t_i, t_j)) per axis.
struct TrackNoise {
  double sigma_px = 0.7;     ///< white part, 1 sigma per axis
  double drift_per_s = 0.0;  ///< variance that a second of the walk adds, over that of the white part [1/s]

  /// Inverse of (delta_ij + drift min(t_i, t_j)). @param times_s ascending, the first one may be zero
  Eigen::MatrixXd information(const std::vector<double>& times_s) const;
};

/// Tells the noise of a run's tracks from their residuals: what neighbouring observations do not share is white, what
/// distant ones share less than near ones is drift. Not thread-safe.
class TrackNoiseEstimator {
 public:
  /// One track: residuals [px] at ascending times [s], with a weight that is small for a track that belongs to nothing.
  void add(const std::vector<double>& times_s, const std::vector<Eigen::Vector2d>& residuals_px, double weight);
  /// Squared residuals of one track, whitened with the noise in use, and what weight times square should be on average.
  void addWhitened(double squared, double expected, double weight);

  /// Ready to estimate: enough tracks were added.
  bool ready() const { return tracks_ >= kMinTracks; }
  /// @param in_use  the noise with which addWhitened()'s residuals were whitened
  TrackNoise estimate(const TrackNoise& in_use) const;

 private:
  static constexpr std::size_t kMinTracks = 50;
  static constexpr std::size_t kFar = 4;  // observations between those that tell the drift

  struct Differences {  // of residuals
    double squares = 0.0, seconds = 0.0, weight = 0.0;
    double mean() const { return squares / weight; }
    double span() const { return seconds / weight; }
  };
  Differences near_, far_;
  double squared_ = 0.0, expected_ = 0.0;
  std::size_t tracks_ = 0;
};

}  // namespace cocalib
