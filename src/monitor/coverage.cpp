#include "cocalib/monitor/coverage.h"

#include <algorithm>
#include <cmath>

namespace cocalib {
namespace {

constexpr double kLongestGapS = 0.1;  // what lies behind a longer gap was not seen
constexpr TimeNs kStepNs = 100'000'000;

}  // namespace

void MotionCoverage::add(const ImuSample& sample) {
  if (!sample.gyro.allFinite() || !sample.accel.allFinite()) return;
  if (last_) {
    const double dt = toSeconds(sample.stamp - last_->stamp);
    if (dt <= 0.0 && dt > -1.0) return;
    if (dt > 0.0 && dt < kLongestGapS) {
      duration_s_ += dt;
      step_rad_ += dt * sample.gyro;
      rate_square_ += dt * sample.gyro.cwiseAbs2();
      accel_sum_ += dt * sample.accel;
      accel_square_ += dt * sample.accel.cwiseAbs2();
    }
  }
  last_ = sample;
  if (std::abs(sample.stamp - step_begin_) < kStepNs) return;
  turned_rad_ += step_rad_.cwiseAbs();
  step_rad_.setZero();
  step_begin_ = sample.stamp;
}

Eigen::Vector3d MotionCoverage::rms_rad_s() const {
  if (duration_s_ <= 0.0) return Eigen::Vector3d::Zero();
  return (rate_square_ / duration_s_).cwiseSqrt();
}

Eigen::Vector3d MotionCoverage::shaken_m_s2() const {
  if (duration_s_ <= 0.0) return Eigen::Vector3d::Zero();
  const Eigen::Vector3d mean = accel_sum_ / duration_s_;
  return (accel_square_ / duration_s_ - mean.cwiseAbs2()).cwiseMax(0.0).cwiseSqrt();
}

void BoardCoverage::add(const VisualKeyframe& keyframe) {
  ++pictures_;
  if (!keyframe.board || width_ <= 0 || height_ <= 0) return;
  ++views_;
  for (const Eigen::Vector2f& corner : keyframe.board->corners_px) {
    const int column = static_cast<int>(std::floor(corner.x() / static_cast<float>(width_) * kColumns));
    const int row = static_cast<int>(std::floor(corner.y() / static_cast<float>(height_) * kRows));
    ++corners_[static_cast<std::size_t>(std::clamp(row, 0, kRows - 1))]
              [static_cast<std::size_t>(std::clamp(column, 0, kColumns - 1))];
  }
}

void BoardCoverage::clear() {
  pictures_ = views_ = 0;
  corners_ = Grid{};
}

double BoardCoverage::coveredShare() const {
  int covered = 0;
  for (const auto& row : corners_) {
    covered += static_cast<int>(std::count_if(row.begin(), row.end(), [](int corners) { return corners > 0; }));
  }
  return static_cast<double>(covered) / (kColumns * kRows);
}

}  // namespace cocalib
