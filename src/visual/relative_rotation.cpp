#include <algorithm>
#include <cmath>

#include "cocalib/visual/feature_tracker.h"
#include "cocalib/visual/two_view.h"

namespace cocalib {
namespace {

constexpr std::size_t kMinCommonTracks = 15;
constexpr double kInlierPx = 1.5;
constexpr double kLossPx = 0.7;            // scale of the Cauchy loss: a good track's error
constexpr double kRotationRansacPx = 6.0;  // tolerates the parallax of a hand-held move
constexpr double kConflictCost = 1.0;      // of a point behind the cameras, as much as an error of 1.3 times the scale
constexpr double kNoParallaxPx = 0.35;     // median, under which a rotation alone explains the pictures

/// Bearings of the tracks that both pictures hold; both lists may be in any order of ids.
BearingPairs commonBearings(std::vector<TrackObservation> a, std::vector<TrackObservation> b,
                            const CameraModel& camera) {
  const auto by_id = [](const TrackObservation& x, const TrackObservation& y) { return x.id < y.id; };
  std::sort(a.begin(), a.end(), by_id);
  std::sort(b.begin(), b.end(), by_id);
  BearingPairs pairs;
  for (std::size_t i = 0, j = 0; i < a.size() && j < b.size();) {
    if (a[i].id < b[j].id) {
      ++i;
    } else if (b[j].id < a[i].id) {
      ++j;
    } else {
      const auto bearing_a = camera.unproject(a[i++].px.cast<double>());
      const auto bearing_b = camera.unproject(b[j++].px.cast<double>());
      if (!bearing_a || !bearing_b) continue;
      pairs.a.push_back(*bearing_a);
      pairs.b.push_back(*bearing_b);
    }
  }
  return pairs;
}

std::vector<double> rotationErrors(const BearingPairs& pairs, const Eigen::Quaterniond& R_b_a) {
  std::vector<double> errors;
  for (std::size_t i = 0; i < pairs.size(); ++i) errors.push_back((pairs.b[i] - R_b_a * pairs.a[i]).norm());
  return errors;
}

/// Nearly plane scenes have two solutions: enough starts to find both.
std::vector<TwoViewMotion> motionStarts(const BearingPairs& pairs, const std::optional<Eigen::Quaterniond>& R_alone,
                                        double px_rad) {
  std::vector<TwoViewMotion> starts;
  if (R_alone) {
    for (const double threshold_px : {kRotationRansacPx, kInlierPx}) {
      const auto start = robustTranslation(pairs, *R_alone, threshold_px * px_rad);
      if (start) starts.push_back(*start);
    }
    for (int axis = 0; axis < 3; ++axis) starts.push_back({*R_alone, Eigen::Vector3d::Unit(axis)});
  }
  if (const auto start = essentialMotion(pairs, kInlierPx * px_rad)) starts.push_back(*start);
  return starts;
}

}  // namespace

std::optional<RelativeRotation> relativeRotation(const std::vector<TrackObservation>& a,
                                                 const std::vector<TrackObservation>& b, const CameraModel& camera) {
  const BearingPairs pairs = commonBearings(a, b, camera);
  if (pairs.size() < kMinCommonTracks) return std::nullopt;
  const double px = 1.0 / camera.focalPx();
  const auto enough = [&](int inliers) { return inliers >= static_cast<int>(kMinCommonTracks) * 2 / 3; };

  const auto R_alone = robustRotation(pairs, kRotationRansacPx * px);
  if (R_alone) {
    std::vector<double> errors = rotationErrors(pairs, *R_alone);
    const auto inliers = std::count_if(errors.begin(), errors.end(), [&](double e) { return e < kInlierPx * px; });
    std::nth_element(errors.begin(), errors.begin() + errors.size() / 2, errors.end());
    if (errors[errors.size() / 2] < kNoParallaxPx * px && enough(static_cast<int>(inliers))) {
      return RelativeRotation{*R_alone, static_cast<int>(inliers)};
    }
  }
  const std::vector<TwoViewMotion> starts = motionStarts(pairs, R_alone, px);
  std::optional<TwoViewMotion> best;
  double best_cost = 0.0;
  for (const TwoViewMotion& start : starts) {
    double cost = 0.0;
    const TwoViewMotion motion = refineMotion(pairs, start, kLossPx * px, &cost);
    cost += kConflictCost * depthConflicts(pairs, motion);
    if (best && cost >= best_cost) continue;
    best = motion;
    best_cost = cost;
  }
  if (!best) return std::nullopt;
  int inliers = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    inliers += std::abs(epipolarError(*best, pairs.a[i], pairs.b[i])) < kInlierPx * px;
  }
  if (!enough(inliers)) return std::nullopt;
  return RelativeRotation{best->R_b_a, inliers};
}

}  // namespace cocalib
