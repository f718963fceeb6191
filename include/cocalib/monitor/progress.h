#pragma once

#include <Eigen/Core>
#include <deque>
#include <optional>
#include <string>

#include "cocalib/estimation/estimate.h"
#include "cocalib/estimation/observability.h"

namespace cocalib {

/// The motion that would help most now.
struct MotionHint {
  Eigen::Vector3d axis_I;  ///< turn about it, back and forth; unit length, IMU frame
  std::string words;       ///< "turn about imu y, back and forth: camera translation along imu z is known to 8.0 mm"
};

/// From the covariance, measured in thresholds: its largest direction is what is known least, and turning about an axis
/// across that direction shows it; of those axes, the one about which the rig has turned least (of two that hardly
/// differ, the first).
/// @param turned_rad  turned about each axis of the IMU so far, back and forth added up [rad]
/// @return nothing once every direction is within its threshold
std::optional<MotionHint> adviseMotion(const CalibrationEstimate& estimate, const Eigen::Vector3d& turned_rad,
                                       const ObservabilityThresholds& thresholds);

/// How fast the uncertainty shrinks, and so how long it will take. Not thread-safe.
class ProgressForecast {
 public:
  explicit ProgressForecast(const ObservabilityThresholds& thresholds) : thresholds_(thresholds) {}

  void add(const CalibrationEstimate& estimate);
  void clear() { entries_.clear(); }

  /// Seconds of motion like that of the last ones until every axis is within its threshold; 0 if all are. Nothing while
  /// it cannot be told, or if it would take more than ten minutes: other motion is needed.
  std::optional<double> secondsLeft() const;

 private:
  struct Entry {
    double duration_s;
    Eigen::Matrix<double, 14, 1> information;  ///< of each parameter, in units of its threshold; 0: not in the rig
  };
  ObservabilityThresholds thresholds_;
  std::deque<Entry> entries_;
};

/// What the user should do now, in a few words. @param stage  what the estimator is doing
std::string nextStep(const CalibrationEstimate& estimate, const std::string& stage,
                     const std::optional<MotionHint>& hint);

/// The state in one line for the console: status, what each axis is known to against its threshold, what is needed
/// still.
std::string progressWords(const CalibrationEstimate& estimate, const std::string& stage,
                          const ObservabilityThresholds& thresholds, const std::optional<double>& seconds_left,
                          const std::optional<MotionHint>& hint);

}  // namespace cocalib
