#include "cocalib/monitor/mounting_watch.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <utility>

namespace cocalib {
namespace {

constexpr double kKeptS = 20.0;  // of inertial data
constexpr const char* kAxes[] = {"x", "y", "z"};

FuserParams pieceParams(FuserParams params, double piece_s, double first_look_s) {
  params.prior.reset();  // a piece is to say what it shows by itself
  params.first_solve_s = first_look_s;
  params.window_s = params.live_window_s = std::max(10.0, 2.0 * piece_s);
  return params;
}

/// "12:03:20", UTC.
std::string clockOf(TimeNs stamp) {
  const TimeNs second = stamp / 1'000'000'000 % 86400;
  char text[16];
  std::snprintf(text, sizeof text, "%02d:%02d:%02d", static_cast<int>(second / 3600),
                static_cast<int>(second / 60 % 60), static_cast<int>(second % 60));
  return text;
}

std::string describe(const std::string& sensor, int axis, double change, TimeNs since) {
  char text[160];
  if (axis < 3) {
    std::snprintf(text, sizeof text, "%s has shifted %.1f mm along imu %s since %s", sensor.c_str(), 1e3 * change,
                  kAxes[axis], clockOf(since).c_str());
  } else {
    std::snprintf(text, sizeof text, "%s has turned %.2f deg about imu %s since %s", sensor.c_str(),
                  change * 180.0 / M_PI, kAxes[axis - 3], clockOf(since).c_str());
  }
  return text;
}

}  // namespace

std::vector<MountingChange> MountingComparison::compare(const CalibrationEstimate& now) const {
  std::vector<MountingChange> changes;
  for (const bool camera : {true, false}) {
    if (std::optional<MountingChange> change = compare(now, camera)) changes.push_back(std::move(*change));
  }
  return changes;
}

std::optional<MountingChange> MountingComparison::compare(const CalibrationEstimate& now, bool camera) const {
  const auto verdict = [camera](const CalibrationEstimate& e) { return camera ? e.camera : e.lidar; };
  const auto pose = [camera](const CalibrationEstimate& e) {
    return camera ? e.calibration.T_imu_camera : e.calibration.T_imu_lidar;
  };
  if (!verdict(now).valid || !verdict(calibrated_).valid) return std::nullopt;
  const int first = camera ? 0 : 6;
  const Matrix6d P = now.covariance.block<6, 6>(first, first) + calibrated_.covariance.block<6, 6>(first, first);
  MountingChange found;
  found.sensor = camera ? "camera" : "lidar";
  found.change = pose(now).minus(pose(calibrated_));
  found.sigma = P.diagonal().cwiseMax(0.0).cwiseSqrt();
  if (!found.change.allFinite() || !found.sigma.allFinite()) return std::nullopt;
  int axis = -1;
  double largest = 1.0;  // in units of what makes a change large and certain
  for (int i = 0; i < 6; ++i) {
    const double least = i < 3 ? params_.least_translation_m : params_.least_rotation_rad;
    const double size = std::abs(found.change[i]) / std::max(least, params_.sigmas * found.sigma[i]);
    if (size <= largest) continue;
    largest = size;
    axis = i;
  }
  if (axis < 0) return std::nullopt;
  found.since = now.stamp - toNs(now.duration_s);
  found.words = describe(found.sensor, axis, found.change[axis], found.since);
  return found;
}

MountingWatch::MountingWatch(const Params& params, const FuserParams& fuser_params, const ImuNoise& imu_noise,
                             const FuserInputs& inputs, const CalibrationEstimate& calibrated)
    : params_(params),
      fuser_params_(fuser_params),
      imu_noise_(imu_noise),
      inputs_(inputs),
      comparison_(params.comparison, calibrated) {
  beginPiece(params_.piece_s);
}

void MountingWatch::addImu(const ImuSample& sample) {
  recent_.push_back(sample);
  while (toSeconds(recent_.back().stamp - recent_.front().stamp) > kKeptS) recent_.pop_front();
  fuser_->addImu(sample);
}

void MountingWatch::beginPiece(double first_look_s) {
  fuser_.emplace(pieceParams(fuser_params_, params_.piece_s, first_look_s), imu_noise_, inputs_);
  for (const ImuSample& sample : recent_) fuser_->addImu(sample);
  // Where the solve starts; as starting points these carry no information.
  fuser_->setVisualEstimate(comparison_.calibrated());
  fuser_->setLidarEstimate(comparison_.calibrated());
}

std::vector<MountingChange> MountingWatch::examine() {
  if (!fuser_->wantsSolve() || !fuser_->solve()) return {};
  const CalibrationEstimate now = fuser_->estimate();
  std::vector<MountingChange> changes = comparison_.compare(now);
  const bool whole = now.duration_s > params_.piece_s - fuser_params_.solve_period_s;
  if (changes.empty() && !whole) return {};  // a second look that is not certain goes on
  ++pieces_;
  const bool confirmed = std::exchange(suspicious_, !changes.empty());
  beginPiece(suspicious_ && !confirmed ? params_.second_look_s : params_.piece_s);
  if (!confirmed) changes.clear();
  return changes;
}

}  // namespace cocalib
