#pragma once

#include <algorithm>
#include <cmath>
#include <optional>

#include "cocalib/measurements/measurements.h"

// What may enter an estimator. Everything that comes from outside is asked first: a single number that is not finite,
// or so large that its square is not, would spread over all states at the next solve. The bounds are beyond what any
// sensor measures; NaN fails every comparison.
namespace cocalib {

constexpr double kLargestRate = 1e3;           ///< [rad/s]
constexpr double kLargestAcceleration = 1e5;   ///< [m/s^2]
constexpr double kLargestDistance_m = 1e6;     ///< of anything from anything
constexpr double kLargestSpeed = 1e4;          ///< [m/s]
constexpr float kLargestRange_m = 1e4F;        ///< of a lidar point
constexpr float kLargestPixel = 1e6F;          ///< coordinate
constexpr float kLongestSweep_s = 2.0F;        ///< from the first point to the last
constexpr double kLargestTimeOffset_s = 10.0;  ///< between two clocks

inline bool isUsable(const ImuSample& sample) {
  return sample.gyro.norm() < kLargestRate && sample.accel.norm() < kLargestAcceleration;
}

/// Tells an inertial sensor whose numbers stand still while they say that it turns: it is stuck, or its driver is. One
/// at rest that says the same for long may just have no noise. Not thread-safe.
class StuckImu {
 public:
  /// @return whether this sample repeats numbers that cannot last
  bool take(const ImuSample& sample) {
    constexpr double kTurning = 0.1;     // one that turns like this feels gravity turn [rad/s]
    constexpr double kLasting_s = 0.05;  // drivers that publish faster than the sensor measures repeat for less
    const bool same = since_ && sample.gyro == since_->gyro && sample.accel == since_->accel;
    if (!same) since_ = sample;
    return sample.gyro.norm() > kTurning && toSeconds(sample.stamp - since_->stamp) > kLasting_s;
  }
  void reset() { since_.reset(); }

 private:
  std::optional<ImuSample> since_;  ///< first of those with the newest one's numbers
};

inline bool isUsable(const Pose& pose) {
  return pose.t.norm() < kLargestDistance_m && std::abs(pose.q.norm() - 1.0) < 1e-6;
}

inline bool isUsable(const NavState& state) {
  return isUsable(state.T_W_I) && state.v_W.norm() < kLargestSpeed && state.gyro_bias.norm() < kLargestRate &&
         state.accel_bias.norm() < kLargestAcceleration;
}

inline bool isUsable(const LidarPoint& point) {
  return point.p.norm() < kLargestRange_m && point.offset_s >= 0.0F && point.offset_s < kLongestSweep_s;
}

inline bool isUsable(const LidarScan& scan) {
  return std::all_of(scan.points.begin(), scan.points.end(), [](const LidarPoint& point) { return isUsable(point); });
}

inline bool isUsable(const Eigen::Vector2f& px) { return px.cwiseAbs().maxCoeff() < kLargestPixel && px.allFinite(); }

/// @param board  of the rig; a view must have all of its corners, and there can be none without it
inline bool isUsable(const VisualKeyframe& keyframe, const std::optional<BoardGeometry>& board) {
  const auto usable = [](const Eigen::Vector2f& px) { return isUsable(px); };
  if (keyframe.board) {
    const std::vector<Eigen::Vector2f>& corners = keyframe.board->corners_px;
    if (!board || corners.size() != static_cast<std::size_t>(board->cornerCount())) return false;
    if (!std::all_of(corners.begin(), corners.end(), usable)) return false;
  }
  return std::all_of(keyframe.tracks.begin(), keyframe.tracks.end(),
                     [&](const TrackObservation& track) { return usable(track.px); }) &&
         (!keyframe.state || isUsable(*keyframe.state));
}

inline bool isUsable(const LidarKeyframe& keyframe) {
  return isUsable(keyframe.scan) && (!keyframe.state || isUsable(*keyframe.state));
}

/// One sensor's part of a calibration.
inline bool isUsable(const Pose& T_imu_sensor, double time_offset_s) {
  return isUsable(T_imu_sensor) && std::abs(time_offset_s) < kLargestTimeOffset_s;
}

}  // namespace cocalib
