#include "cocalib/visual/feature_tracker.h"

#include <algorithm>
#include <cmath>
#include <opencv2/imgproc.hpp>
#include <opencv2/video/tracking.hpp>
#include <stdexcept>
#include <utility>

#include "cocalib/visual/two_view.h"

namespace cocalib {
namespace {

const cv::Size kWindow(15, 15);
constexpr int kPyramidLevels = 3;
constexpr int kPredictedLevels = 2;       // a prediction by rotation is off by parallax only
constexpr std::size_t kGuessTracks = 50;  // tell the rotation where no gyro does
constexpr int kBackwardLevels = 1;        // starts where it should end
constexpr double kMinEigenvalue = 1e-4;   // of the tracker's gradient matrix: texture lost
constexpr double kBorderPx = 8.0;         // half a window
constexpr std::size_t kMinEpipolarPairs = 12;
constexpr double kRotationRansacPx = 8.0;  // tolerates parallax
constexpr double kMinInlierShare = 0.6;    // below, the start of the refinement was wrong
constexpr int kCellsPerPicture = 10;       // topped up, while there are tracks
constexpr int kCornerBlock = 5;
// Least gradient of a corner in its weaker direction [grey levels / px], as cv::cornerMinEigenVal scales it.
constexpr double kMinGradient = 3.0;
constexpr double kMinCorner = 4.0 * kMinGradient * kMinGradient / (255.0 * 255.0);

std::vector<cv::Mat> pyramidOf(const cv::Mat& gray) {
  std::vector<cv::Mat> pyramid;
  cv::buildOpticalFlowPyramid(gray, pyramid, kWindow, kPyramidLevels, true, cv::BORDER_REFLECT_101, cv::BORDER_CONSTANT,
                              false);  // own copy: the caller may reuse the picture's memory
  return pyramid;
}

cv::TermCriteria iterations(int count, double step_px) {
  return cv::TermCriteria(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, count, step_px);
}

/// Which pairs obey one epipolar geometry; all, where there are too few to tell.
std::vector<bool> epipolarInliers(const BearingPairs& pairs, const std::optional<Eigen::Quaterniond>& R_b_a,
                                  double threshold_rad, double px_rad) {
  std::vector<bool> inliers(pairs.size(), true);
  if (pairs.size() < kMinEpipolarPairs) return inliers;
  const auto mark = [&](const TwoViewMotion& motion) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      inliers[i] = std::abs(epipolarError(motion, pairs.a[i], pairs.b[i])) < threshold_rad;
      count += inliers[i];
    }
    return static_cast<double>(count) >= kMinInlierShare * static_cast<double>(pairs.size());
  };
  const auto R = R_b_a ? R_b_a : robustRotation(pairs, kRotationRansacPx * px_rad);
  if (R) {
    // A rotation that is only guessed needs room for its error.
    const auto start = robustTranslation(pairs, *R, R_b_a ? threshold_rad : 3.0 * threshold_rad);
    if (start && mark(R_b_a ? *start : refineMotion(pairs, *start, 0.5 * threshold_rad))) return inliers;
  }
  if (const auto start = essentialMotion(pairs, threshold_rad)) {
    mark(refineMotion(pairs, *start, 0.5 * threshold_rad));
  } else {
    std::fill(inliers.begin(), inliers.end(), true);
  }
  return inliers;
}

}  // namespace

FeatureTracker::FeatureTracker(const CameraModel& camera, const Params& params) : camera_(camera), params_(params) {
  if (params.max_features < 1 || params.grid_cols < 1 || params.grid_rows < 1) {
    throw std::invalid_argument("max_features, grid_cols and grid_rows must be >= 1");
  }
  if (!(params.min_distance_px >= 1.0) || !(params.max_forward_backward_px > 0.0) || !(params.ransac_px > 0.0)) {
    throw std::invalid_argument("min_distance_px must be >= 1, max_forward_backward_px and ransac_px > 0");
  }
}

void FeatureTracker::reset() {
  tracks_.clear();
  pyramid_.clear();
  rotation_ = Eigen::Quaterniond::Identity();
}

std::vector<TrackObservation> FeatureTracker::track(const ImageFrame& image,
                                                    const std::optional<Eigen::Quaterniond>& R_Cnow_Cprev,
                                                    const std::vector<Eigen::Vector2f>& mask_px) {
  if (image.gray.type() != CV_8UC1 || image.gray.cols != camera_.width() || image.gray.rows != camera_.height()) {
    reset();
    return {};
  }
  const cv::Mat even = evenOut(image.gray);
  std::vector<cv::Mat> pyramid = pyramidOf(even);
  if (!tracks_.empty()) {
    rotation_ = R_Cnow_Cprev ? *R_Cnow_Cprev : guessRotation(pyramid);
    tracks_ = follow(image.gray, pyramid, R_Cnow_Cprev.has_value());
  }
  topUp(image.gray, mask_px);
  pyramid_ = even.data == image.gray.data ? std::move(pyramid) : pyramidOf(image.gray);
  std::vector<TrackObservation> observations;
  observations.reserve(tracks_.size());
  for (const Track& track : tracks_) observations.push_back({track.id, {track.px.x, track.px.y}});
  return observations;
}

std::vector<cv::Point2f> FeatureTracker::predict(const std::vector<Track>& tracks) const {
  std::vector<cv::Point2f> predicted;
  for (const Track& track : tracks) {
    predicted.push_back(track.px);
    const auto px = camera_.project(rotation_ * track.bearing);
    if (px && camera_.inImage(*px)) predicted.back() = cv::Point2f(px->cast<float>().x(), px->cast<float>().y());
  }
  return predicted;
}

Eigen::Quaterniond FeatureTracker::guessRotation(const std::vector<cv::Mat>& pyramid) const {
  std::vector<Track> some;
  const std::size_t stride = (tracks_.size() + kGuessTracks - 1) / kGuessTracks;
  for (std::size_t i = 0; i < tracks_.size(); i += stride) some.push_back(tracks_[i]);
  std::vector<cv::Point2f> before, now = predict(some);
  for (const Track& track : some) before.push_back(track.px);
  std::vector<std::uint8_t> found;
  cv::calcOpticalFlowPyrLK(pyramid_, pyramid, before, now, found, cv::noArray(), kWindow, kPyramidLevels,
                           iterations(10, 0.1), cv::OPTFLOW_USE_INITIAL_FLOW, kMinEigenvalue);
  BearingPairs pairs;
  for (std::size_t i = 0; i < some.size(); ++i) {
    const Eigen::Vector2d px(now[i].x, now[i].y);
    if (!found[i] || !camera_.inImage(px)) continue;
    const auto bearing = camera_.unproject(px);
    if (!bearing) continue;
    pairs.a.push_back(some[i].bearing);
    pairs.b.push_back(*bearing);
  }
  if (pairs.size() < kMinEpipolarPairs) return rotation_;
  return robustRotation(pairs, kRotationRansacPx / camera_.focalPx()).value_or(rotation_);
}

cv::Mat FeatureTracker::evenOut(const cv::Mat& gray) {
  constexpr double kStep = 0.1;         // less is left to the tracker, which bears it
  constexpr double kMinContrast = 8.0;  // grey levels; a picture with less shows nothing to follow
  cv::Scalar mean, contrast;
  cv::meanStdDev(gray, mean, contrast);
  const double mean_before = std::exchange(mean_, mean[0]), contrast_before = std::exchange(contrast_, contrast[0]);
  if (tracks_.empty() || contrast_ < kMinContrast || contrast_before < kMinContrast) return gray;
  const double factor = contrast_before / contrast_;
  if (std::abs(std::log(factor)) < kStep) return gray;
  cv::Mat even;
  gray.convertTo(even, CV_8UC1, factor, mean_before - factor * mean_);
  return even;
}

bool FeatureTracker::measure(const cv::Mat& gray, Track* track) {
  const auto place = track->patch->find(gray, {{track->px.x, track->px.y}, track->A});
  if (!place) return false;
  track->A = place->A;
  track->px = cv::Point2f(place->center.cast<float>().x(), place->center.cast<float>().y());
  return true;
}

bool FeatureTracker::beginAnew(const cv::Mat& gray, Track* track) {
  const auto patch = ReferencePatch::cut(gray, {track->px.x, track->px.y});
  if (!patch) return false;
  track->patch = std::make_shared<const ReferencePatch>(*patch);
  track->A.setIdentity();
  track->id = next_id_++;
  return true;
}

std::vector<bool> FeatureTracker::returns(const std::vector<cv::Mat>& pyramid, const std::vector<cv::Point2f>& before,
                                          const std::vector<cv::Point2f>& now) const {
  std::vector<bool> good(now.size(), false);
  if (now.empty()) return good;
  std::vector<cv::Point2f> back = before;
  std::vector<std::uint8_t> found;
  cv::calcOpticalFlowPyrLK(pyramid, pyramid_, now, back, found, cv::noArray(), kWindow, kBackwardLevels,
                           iterations(10, 0.05), cv::OPTFLOW_USE_INITIAL_FLOW, kMinEigenvalue);
  for (std::size_t i = 0; i < now.size(); ++i) {
    good[i] = found[i] != 0 && cv::norm(back[i] - before[i]) <= params_.max_forward_backward_px;
  }
  return good;
}

std::vector<FeatureTracker::Track> FeatureTracker::followed(const cv::Mat& gray, const std::vector<cv::Mat>& pyramid) {
  std::vector<cv::Point2f> before, now = predict(tracks_);
  for (const Track& track : tracks_) before.push_back(track.px);
  std::vector<std::uint8_t> found;
  cv::calcOpticalFlowPyrLK(pyramid_, pyramid, before, now, found, cv::noArray(), kWindow, kPredictedLevels,
                           iterations(10, 0.03), cv::OPTFLOW_USE_INITIAL_FLOW, kMinEigenvalue);
  // The picture in which a track began confirms it; where it does not, the way back must lead to where it came from.
  std::vector<Track> tracks, lost;
  std::vector<cv::Point2f> lost_before, lost_now;
  for (std::size_t i = 0; i < before.size(); ++i) {
    if (!found[i] || !camera_.inImage({now[i].x, now[i].y}, kBorderPx)) continue;
    Track track = tracks_[i];
    track.px = now[i];
    if (measure(gray, &track)) {
      tracks.push_back(track);
    } else {
      lost.push_back(track);
      lost_before.push_back(before[i]);
      lost_now.push_back(now[i]);
    }
  }
  const std::vector<bool> good = returns(pyramid, lost_before, lost_now);
  for (std::size_t i = 0; i < lost.size(); ++i) {
    if (good[i] && beginAnew(gray, &lost[i])) tracks.push_back(lost[i]);
  }
  return tracks;
}

std::vector<FeatureTracker::Track> FeatureTracker::follow(const cv::Mat& gray, const std::vector<cv::Mat>& pyramid,
                                                          bool rotation_known) {
  std::vector<Track> tracks;
  BearingPairs pairs;
  for (Track& track : followed(gray, pyramid)) {
    const Eigen::Vector2d px(track.px.x, track.px.y);
    const auto bearing = camera_.unproject(px);
    if (!camera_.inImage(px, kBorderPx) || !bearing) continue;
    pairs.a.push_back(std::exchange(track.bearing, *bearing));
    pairs.b.push_back(*bearing);
    tracks.push_back(std::move(track));
  }
  const double px_rad = 1.0 / camera_.focalPx();
  const std::vector<bool> inliers =
      epipolarInliers(pairs, rotation_known ? std::optional<Eigen::Quaterniond>(rotation_) : std::nullopt,
                      params_.ransac_px * px_rad, px_rad);
  std::vector<Track> kept;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    if (inliers[i]) kept.push_back(tracks[i]);
  }
  return kept;
}

void FeatureTracker::topUp(const cv::Mat& gray, const std::vector<Eigen::Vector2f>& mask_px) {
  std::vector<cv::Point2f> mask;
  for (const Eigen::Vector2f& px : mask_px) mask.emplace_back(px.x(), px.y());
  const int cell_count = params_.grid_cols * params_.grid_rows;
  const auto boundary = [](int i, int n, int size) {
    return static_cast<int>(static_cast<std::int64_t>(i) * size / n);
  };
  std::vector<std::size_t> occupied(cell_count, 0);
  for (const Track& track : tracks_) {
    const int col = std::clamp(static_cast<int>(track.px.x * params_.grid_cols / gray.cols), 0, params_.grid_cols - 1);
    const int row = std::clamp(static_cast<int>(track.px.y * params_.grid_rows / gray.rows), 0, params_.grid_rows - 1);
    ++occupied[row * params_.grid_cols + col];
  }
  const std::size_t per_cell = (params_.max_features + cell_count - 1) / cell_count;
  // A share of the cells a picture, in turn, so that cells without texture do not cost time in every picture.
  int budget = tracks_.empty() ? cell_count : std::min(kCellsPerPicture, cell_count);
  for (int k = 0; k < cell_count && budget > 0; ++k) {
    const int cell = next_cell_;
    next_cell_ = (next_cell_ + 1) % cell_count;
    const std::size_t room = params_.max_features - std::min<std::size_t>(params_.max_features, tracks_.size());
    if (room == 0) break;
    if (occupied[cell] >= per_cell) continue;
    --budget;
    const int col = cell % params_.grid_cols, row = cell / params_.grid_cols;
    const cv::Point first(boundary(col, params_.grid_cols, gray.cols), boundary(row, params_.grid_rows, gray.rows));
    const cv::Point end(boundary(col + 1, params_.grid_cols, gray.cols),
                        boundary(row + 1, params_.grid_rows, gray.rows));
    topUpCell(gray, cv::Rect(first, end), std::min(room, per_cell - occupied[cell]), mask);
  }
}

void FeatureTracker::topUpCell(const cv::Mat& gray, const cv::Rect& cell, std::size_t wanted,
                               const std::vector<cv::Point2f>& mask) {
  if (cell.width < 3 || cell.height < 3) return;
  cv::Mat strength;
  cv::cornerMinEigenVal(gray(cell), strength, kCornerBlock, 3);
  struct Corner {
    float strength;
    cv::Point px;
  };
  std::vector<Corner> corners;
  for (int y = 1; y + 1 < strength.rows; ++y) {
    const float *above = strength.ptr<float>(y - 1), *row = strength.ptr<float>(y), *below = strength.ptr<float>(y + 1);
    for (int x = 1; x + 1 < strength.cols; ++x) {
      const float value = row[x];
      if (value < kMinCorner || value < row[x - 1] || value <= row[x + 1] || value < above[x - 1] || value < above[x] ||
          value < above[x + 1] || value <= below[x - 1] || value <= below[x] || value <= below[x + 1]) {
        continue;
      }
      corners.push_back({value, cell.tl() + cv::Point(x, y)});
    }
  }
  std::stable_sort(corners.begin(), corners.end(),
                   [](const auto& a, const auto& b) { return a.strength > b.strength; });
  const double min_distance2 = params_.min_distance_px * params_.min_distance_px;
  for (const Corner& corner : corners) {
    if (wanted == 0) return;
    const cv::Point2f px = corner.px;
    if (!camera_.inImage({px.x, px.y}, kBorderPx)) continue;
    if (mask.size() >= 3 && cv::pointPolygonTest(mask, px, false) >= 0.0) continue;
    const bool crowded = std::any_of(tracks_.begin(), tracks_.end(), [&](const Track& track) {
      const cv::Point2f d = track.px - px;
      return static_cast<double>(d.dot(d)) < min_distance2;
    });
    if (crowded) continue;
    const auto bearing = camera_.unproject({px.x, px.y});
    const auto patch = ReferencePatch::cut(gray, {px.x, px.y});
    if (!bearing || !patch) continue;
    tracks_.push_back({next_id_++, px, *bearing, std::make_shared<const ReferencePatch>(*patch)});
    --wanted;
  }
}

}  // namespace cocalib
