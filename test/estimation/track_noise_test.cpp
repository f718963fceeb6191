#include "cocalib/estimation/track_noise.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <random>

namespace cocalib {
namespace {

const std::vector<double> kTimes = {0.0, 0.12, 0.24, 0.36, 0.50, 0.62, 0.75, 0.87, 1.00, 1.12};

/// Errors of tracks as TrackNoise describes them.
class NoisyTracks {
 public:
  explicit NoisyTracks(const TrackNoise& noise) : noise_(noise) {}
  std::vector<Eigen::Vector2d> draw() {
    std::vector<Eigen::Vector2d> errors;
    Eigen::Vector2d walk = Eigen::Vector2d::Zero();
    for (std::size_t i = 0; i < kTimes.size(); ++i) {
      const double dt = i == 0 ? 0.0 : kTimes[i] - kTimes[i - 1];
      walk += noise_.sigma_px * std::sqrt(noise_.drift_per_s * dt) * normal2();
      errors.push_back(walk + noise_.sigma_px * normal2());
    }
    return errors;
  }

 private:
  Eigen::Vector2d normal2() {
    const double x = normal_(random_);
    return {x, normal_(random_)};
  }
  TrackNoise noise_;
  std::mt19937 random_{7};
  std::normal_distribution<double> normal_;
};

/// Places of a track's observations: ten tracks are always side by side, in a part of each of their pictures.
std::vector<std::size_t> placesOf(int track) {
  std::vector<std::size_t> places;
  for (std::size_t i = 0; i < kTimes.size(); ++i) {
    places.push_back(static_cast<std::size_t>(track / 10) * kTimes.size() + i);
  }
  return places;
}

double whitened(const TrackNoise& noise, const std::vector<Eigen::Vector2d>& errors) {
  const Eigen::MatrixXd information = noise.information(kTimes);
  double sum = 0.0;
  for (std::size_t i = 0; i < errors.size(); ++i) {
    for (std::size_t j = 0; j < errors.size(); ++j) {
      sum += information(static_cast<Eigen::Index>(i), static_cast<Eigen::Index>(j)) * errors[i].dot(errors[j]);
    }
  }
  return sum / (noise.sigma_px * noise.sigma_px);
}

TEST(TrackNoise, InformationInvertsTheCovariance) {
  for (const std::vector<double>& times : {kTimes, std::vector<double>{0.3, 0.4, 0.41}, std::vector<double>{0.0}}) {
    for (const double drift_per_s : {0.0, 1e-6, 3.0, 200.0}) {
      const auto n = static_cast<Eigen::Index>(times.size());
      Eigen::MatrixXd covariance = Eigen::MatrixXd::Identity(n, n);
      for (Eigen::Index i = 0; i < n; ++i) {
        for (Eigen::Index j = 0; j < n; ++j) {
          covariance(i, j) += drift_per_s * times[static_cast<std::size_t>(std::min(i, j))];
        }
      }
      const Eigen::MatrixXd product = TrackNoise{0.3, drift_per_s}.information(times) * covariance;
      EXPECT_LT((product - Eigen::MatrixXd::Identity(n, n)).cwiseAbs().maxCoeff(), 1e-9) << drift_per_s;
    }
  }
}

TEST(TrackNoise, WhitensWhatItDescribes) {
  for (const TrackNoise noise : {TrackNoise{0.3, 0.0}, TrackNoise{0.1, 20.0}}) {
    NoisyTracks tracks(noise);
    double sum = 0.0;
    constexpr int kTracks = 2000;
    for (int i = 0; i < kTracks; ++i) sum += whitened(noise, tracks.draw());
    // 20 degrees of freedom a track; the mean of 2000 is known to sqrt(40 / 2000).
    EXPECT_NEAR(sum / kTracks, 20.0, 4.0 * std::sqrt(40.0 / kTracks)) << noise.drift_per_s;
  }
}

TEST(TrackNoise, IsToldFromResiduals) {
  for (const TrackNoise truth : {TrackNoise{0.3, 0.0}, TrackNoise{0.1, 20.0}, TrackNoise{0.5, 2.0}}) {
    NoisyTracks tracks(truth);
    TrackNoise noise;  // the default, far from it
    for (int round = 0; round < 3; ++round) {
      TrackNoiseEstimator estimator;
      for (int i = 0; i < 2000; ++i) {
        std::vector<Eigen::Vector2d> errors = tracks.draw();
        const double squared = whitened(noise, errors);
        for (Eigen::Vector2d& error : errors) error /= noise.sigma_px;
        estimator.add(kTimes, placesOf(i), errors, 1.0);
        estimator.addWhitened(squared, 20.0, 1.0);
      }
      ASSERT_TRUE(estimator.ready());
      noise = estimator.estimate(noise);
    }
    EXPECT_NEAR(noise.sigma_px, truth.sigma_px, 0.05 * truth.sigma_px) << truth.drift_per_s;
    EXPECT_NEAR(noise.drift_per_s, truth.drift_per_s, 0.15 * truth.drift_per_s + 0.1);
  }
}

TEST(TrackNoise, TracksThatShareAnErrorTellLess) {
  constexpr double kShare = 0.3;  // of the variance
  NoisyTracks own({0.2 * std::sqrt(1.0 - kShare), 0.0}), common({0.2 * std::sqrt(kShare), 0.0});
  TrackNoise noise;
  TrackNoiseEstimator estimator;
  std::vector<Eigen::Vector2d> shared;
  for (int i = 0; i < 5000; ++i) {
    if (i % 10 == 0) shared = common.draw();
    std::vector<Eigen::Vector2d> errors = own.draw();
    for (std::size_t k = 0; k < errors.size(); ++k) errors[k] += shared[k];
    const double squared = whitened(noise, errors);
    for (Eigen::Vector2d& error : errors) error /= noise.sigma_px;
    estimator.add(kTimes, placesOf(i), errors, 1.0);
    estimator.addWhitened(squared, 20.0, 1.0);
  }
  const double expected = 1.0 + 9.0 * kShare;  // ten side by side
  EXPECT_NEAR(estimator.designEffect(), expected, 0.1 * expected);
  EXPECT_NEAR(estimator.estimate(noise).sigma_px, 0.2 * std::sqrt(expected), 0.1 * 0.2 * std::sqrt(expected));
}

TEST(TrackNoise, AsksForEnoughTracks) {
  TrackNoiseEstimator estimator;
  EXPECT_FALSE(estimator.ready());
  estimator.add(kTimes, placesOf(0), std::vector<Eigen::Vector2d>(kTimes.size(), Eigen::Vector2d::Zero()), 1.0);
  EXPECT_FALSE(estimator.ready());
}

}  // namespace
}  // namespace cocalib
