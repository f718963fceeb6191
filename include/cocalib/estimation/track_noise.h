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
/// distant ones share less than near ones is drift.
///
/// Errors of the lens model, of the exposure or of a surface that many tracks lie on are common to tracks that are side
/// by side in a picture, and n of them then tell less than n times as much. So the steps of all tracks in one part of
/// one picture are summed: independent ones have a sum whose square is that of the steps, and as many times as it is
/// larger, the variance of every track is taken to be larger (the design effect of cluster sampling, Kish 1965).
/// Not thread-safe.
class TrackNoiseEstimator {
 public:
  /// One track: residuals [px] at ascending times [s], with a weight that is small for a track that belongs to nothing.
  /// @param places  of each observation: the number of the part of the picture that it lies in, over all pictures
  void add(const std::vector<double>& times_s, const std::vector<std::size_t>& places,
           const std::vector<Eigen::Vector2d>& residuals_px, double weight);
  /// Squared residuals of one track, whitened with the noise in use, and what weight times square should be on average.
  void addWhitened(double squared, double expected, double weight);

  /// Ready to estimate: enough tracks were added.
  bool ready() const { return tracks_ >= kMinTracks; }
  /// @param in_use  the noise with which addWhitened()'s residuals were whitened
  TrackNoise estimate(const TrackNoise& in_use) const;
  /// Variance of what tracks in one place say together, over what it would be were they independent; 1 or more.
  double designEffect() const;

 private:
  static constexpr std::size_t kMinTracks = 50;
  static constexpr std::size_t kFar = 4;  // observations between those that tell the drift

  struct Differences {  // of residuals
    double squares = 0.0, seconds = 0.0, weight = 0.0;
    double mean() const { return squares / weight; }
    double span() const { return seconds / weight; }
  };
  struct Place {
    Eigen::Vector2d sum = Eigen::Vector2d::Zero();  // of the steps since the observations before
    double squares = 0.0;
  };
  Differences near_, far_;
  std::vector<Place> places_;
  double squared_ = 0.0, expected_ = 0.0;
  std::size_t tracks_ = 0;
};

}  // namespace cocalib
