#include "cocalib/visual/feature_tracker.h"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <opencv2/imgproc.hpp>
#include <random>
#include <stdexcept>

namespace cocalib {
namespace {

const CameraModel kCamera(CameraModel::Distortion::kRadTan, {458.0, 457.0, 367.0, 248.0},
                          {-0.283, 0.0739, 0.0002, 1.7e-5}, 752, 480);

/// Grey level of a textured sphere around the camera in direction `bearing`: blurred random cells.
class Sky {
 public:
  Sky() : texture_(1000, 2000, CV_8U) {
    std::mt19937 random(5);
    cv::Mat cells(100, 200, CV_8U);
    for (int i = 0; i < cells.rows * cells.cols; ++i) cells.data[i] = static_cast<std::uint8_t>(random() % 256);
    cv::resize(cells, texture_, texture_.size(), 0, 0, cv::INTER_CUBIC);
    for (int y = 0; y < 480; ++y) {
      for (int x = 0; x < 752; ++x) {
        bearings_.push_back(kCamera.unproject({static_cast<double>(x), static_cast<double>(y)})->cast<float>());
      }
    }
  }
  cv::Mat picture(const Eigen::Quaterniond& R_W_C, std::uint32_t seed) const {
    cv::Mat map_x(480, 752, CV_32F), map_y(480, 752, CV_32F), gray;
    const Eigen::Matrix3f R = R_W_C.toRotationMatrix().cast<float>();
    for (int i = 0; i < 480 * 752; ++i) {
      const Eigen::Vector3f p = R * bearings_[i];
      map_x.at<float>(i / 752, i % 752) = 1000.0F + 500.0F * std::atan2(p.x(), p.z());
      map_y.at<float>(i / 752, i % 752) = 500.0F + 500.0F * std::asin(p.y());
    }
    cv::remap(texture_, gray, map_x, map_y, cv::INTER_LINEAR, cv::BORDER_REPLICATE);
    std::mt19937 random(seed);
    for (int i = 0; i < 480 * 752; ++i) {
      gray.data[i] = cv::saturate_cast<std::uint8_t>(gray.data[i] + static_cast<int>(random() % 7) - 3);
    }
    return gray;
  }

 private:
  cv::Mat texture_;
  std::vector<Eigen::Vector3f> bearings_;
};
const Sky& sky() {
  static const Sky instance;
  return instance;
}

Eigen::Quaterniond attitude(int k) {  // up to 1.2 rad/s at 20 pictures a second
  const double t = 0.05 * k;
  return expSo3({0.1 * std::sin(5.0 * t), 0.18 * std::sin(4.0 * t), 0.18 * std::sin(3.0 * t)});
}

TEST(FeatureTracker, TracksStayOnTheirPointsWithAndWithoutTheGyro) {
  for (const bool gyro : {false, true}) {
    FeatureTracker tracker(kCamera, {});
    std::map<std::uint32_t, Eigen::Vector3d> first_W;
    std::vector<double> drift_px;
    std::size_t tracked = 0, total = 0;
    for (int k = 0; k < 15; ++k) {
      std::optional<Eigen::Quaterniond> R_Cnow_Cprev;
      if (gyro && k > 0) R_Cnow_Cprev = attitude(k).conjugate() * attitude(k - 1);
      const auto tracks = tracker.track({k * 50000000LL, sky().picture(attitude(k), k)}, R_Cnow_Cprev);
      ASSERT_GT(tracks.size(), 60U) << k;
      ASSERT_LE(tracks.size(), 150U);
      for (const TrackObservation& track : tracks) {
        const Eigen::Vector3d p_W = attitude(k) * *kCamera.unproject(track.px.cast<double>());
        const auto [entry, is_new] = first_W.emplace(track.id, p_W);
        total += k > 0;
        if (is_new) continue;
        ++tracked;
        drift_px.push_back((entry->second - p_W).norm() * kCamera.focalPx());
      }
    }
    std::sort(drift_px.begin(), drift_px.end());
    EXPECT_GT(static_cast<double>(tracked), 0.75 * static_cast<double>(total));
    // Each is measured against the picture it began in: what is left is the noise of two patches.
    EXPECT_LT(drift_px[drift_px.size() / 2], 0.15);
    EXPECT_LT(drift_px[drift_px.size() * 99 / 100], 1.0);
  }
}

TEST(FeatureTracker, BearsStepsOfTheBrightness) {
  FeatureTracker tracker(kCamera, {});
  std::vector<TrackObservation> before;
  const double levels[] = {1.0, 0.5, 0.9, 0.45, 1.0};
  for (int k = 0; k < 5; ++k) {
    cv::Mat picture = sky().picture(attitude(k), k);
    picture.convertTo(picture, -1, levels[k]);
    std::optional<Eigen::Quaterniond> R_Cnow_Cprev;
    if (k > 0) R_Cnow_Cprev = attitude(k).conjugate() * attitude(k - 1);
    const auto tracks = tracker.track({k * 50000000LL, picture}, R_Cnow_Cprev);
    std::size_t kept = 0;
    for (const TrackObservation& old : before) {
      kept += std::any_of(tracks.begin(), tracks.end(), [&](const auto& track) { return track.id == old.id; });
    }
    if (k > 0) {
      EXPECT_GT(static_cast<double>(kept), 0.6 * static_cast<double>(before.size())) << k;
    }
    before = tracks;
  }
}

TEST(FeatureTracker, NewFeaturesKeepTheirDistanceAndLeaveTheMaskAlone) {
  FeatureTracker::Params params;
  FeatureTracker tracker(kCamera, params);
  const std::vector<Eigen::Vector2f> mask = {{200, 100}, {500, 120}, {480, 350}, {210, 330}};
  const auto tracks = tracker.track({0, sky().picture(attitude(0), 1)}, std::nullopt, mask);
  const std::vector<cv::Point2f> outline = {{200, 100}, {500, 120}, {480, 350}, {210, 330}};
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    EXPECT_LT(cv::pointPolygonTest(outline, {tracks[i].px.x(), tracks[i].px.y()}, false), 0.0);
    for (std::size_t j = 0; j < i; ++j) EXPECT_GE((tracks[i].px - tracks[j].px).norm(), params.min_distance_px);
  }
  EXPECT_GT(tracks.size(), 60U);
}

TEST(FeatureTracker, IdsAreNeverUsedTwice) {
  FeatureTracker tracker(kCamera, {});
  const cv::Mat picture = sky().picture(attitude(0), 1);
  const auto before = tracker.track({0, picture});
  tracker.reset();
  const auto after = tracker.track({50000000, picture});
  std::uint32_t largest = 0;
  for (const auto& track : before) largest = std::max(largest, track.id);
  for (const auto& track : after) EXPECT_GT(track.id, largest);
}

TEST(FeatureTracker, LivesThroughBlackoutAndOddPictures) {
  FeatureTracker tracker(kCamera, {});
  ASSERT_FALSE(tracker.track({0, sky().picture(attitude(0), 1)}).empty());
  const cv::Mat black(480, 752, CV_8U, cv::Scalar(0));
  EXPECT_LT(tracker.track({1, black}).size(), 5U);
  EXPECT_TRUE(tracker.track({2, black}).empty());
  EXPECT_TRUE(tracker.track({3, cv::Mat()}).empty());
  EXPECT_TRUE(tracker.track({4, cv::Mat(10, 10, CV_8U, cv::Scalar(0))}).empty());
  EXPECT_FALSE(tracker.track({5, sky().picture(attitude(0), 1)}).empty());
}

TEST(FeatureTracker, DoesNotDependOnTheNumberOfThreads) {
  std::vector<std::vector<TrackObservation>> results;
  const int threads = cv::getNumThreads();
  for (const int count : {1, 4}) {
    cv::setNumThreads(count);
    FeatureTracker tracker(kCamera, {});
    for (int k = 0; k < 3; ++k) results.push_back(tracker.track({k * 50000000LL, sky().picture(attitude(k), k)}));
  }
  cv::setNumThreads(threads);
  for (int k = 0; k < 3; ++k) {
    ASSERT_EQ(results[k].size(), results[k + 3].size());
    for (std::size_t i = 0; i < results[k].size(); ++i) {
      EXPECT_EQ(results[k][i].id, results[k + 3][i].id);
      EXPECT_EQ(results[k][i].px, results[k + 3][i].px);
    }
  }
}

TEST(FeatureTracker, RefusesImpossibleSettings) {
  FeatureTracker::Params params;
  params.max_features = 0;
  EXPECT_THROW(FeatureTracker(kCamera, params), std::invalid_argument);
  params = {};
  params.ransac_px = 0.0;
  EXPECT_THROW(FeatureTracker(kCamera, params), std::invalid_argument);
}

}  // namespace
}  // namespace cocalib
