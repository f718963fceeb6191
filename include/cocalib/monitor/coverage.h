#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>

#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// How the rig was moved: what decides whether a calibration can be known. Not thread-safe.
class MotionCoverage {
 public:
  void add(const ImuSample& sample);
  void clear() { *this = MotionCoverage(); }

  double duration_s() const { return duration_s_; }
  /// Turned about each axis of the IMU, back and forth added up; what comes and goes within a tenth of a second is
  /// taken for noise, which would add up to degrees a minute [rad].
  Eigen::Vector3d turned_rad() const { return turned_rad_ + step_rad_.cwiseAbs(); }
  /// RMS angular rate about each axis [rad/s].
  Eigen::Vector3d rms_rad_s() const;
  /// RMS of the specific force about its mean, along each axis: shaking and tilting [m/s^2].
  Eigen::Vector3d shaken_m_s2() const;

 private:
  std::optional<ImuSample> last_;
  double duration_s_ = 0.0;
  Eigen::Vector3d turned_rad_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d step_rad_ = Eigen::Vector3d::Zero();  // turned since step_begin_, with its sign
  TimeNs step_begin_ = 0;
  Eigen::Vector3d rate_square_ = Eigen::Vector3d::Zero(), accel_sum_ = Eigen::Vector3d::Zero(),
                  accel_square_ = Eigen::Vector3d::Zero();  // integrals over time
};

/// Where in the picture the chessboard's corners were seen. Not thread-safe.
class BoardCoverage {
 public:
  static constexpr int kColumns = 16, kRows = 10;
  using Grid = std::array<std::array<int, kColumns>, kRows>;

  void setPictureSize(int width, int height) {
    width_ = width;
    height_ = height;
  }
  void add(const VisualKeyframe& keyframe);
  void clear();

  int pictures() const { return pictures_; }
  int views() const { return views_; }
  /// Corners that fell into each cell of the picture.
  const Grid& corners() const { return corners_; }
  /// Cells that hold a corner, of all [0..1].
  double coveredShare() const;

 private:
  int width_ = 0, height_ = 0, pictures_ = 0, views_ = 0;
  Grid corners_{};
};

}  // namespace cocalib
