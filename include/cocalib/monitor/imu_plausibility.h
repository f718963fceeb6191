#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/measurements/finding.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Whether the numbers of an IMU can be what they are taken for: rad/s and m/s^2 with gravity, within the sensor's
/// range, both sensors about the same axes. Not thread-safe. Deterministic.
class ImuPlausibility {
 public:
  void add(const ImuSample& sample);

  /// What the data so far show; nothing before two seconds of them.
  std::vector<Finding> findings(const std::string& topic) const;

 private:
  /// How often one channel stands at its largest value, and how often a little below.
  struct Channel {
    double largest = 0.0;       ///< magnitude
    double counted_from = 0.0;  ///< the largest one when `below` was last zero
    int at_largest = 0, below = 0;
    void add(double value);
    bool isSaturated(double least) const;
  };
  /// Sums over a tenth of a second.
  struct Block {
    TimeNs begin = 0;
    int samples = 0;
    Eigen::Vector3d gyro = Eigen::Vector3d::Zero(), accel = Eigen::Vector3d::Zero();
  };
  void finishBlock();
  std::optional<Finding> judgeAcceleration(const std::string& topic) const;
  std::optional<Finding> judgeRotation(const std::string& topic) const;

  std::optional<TimeNs> first_;
  TimeNs last_ = 0;
  std::vector<double> accel_norms_;  // of the blocks
  double fastest_ = 0.0;             // largest angular rate, as given
  std::array<Channel, 6> channels_;  // gyro, accelerometer
  Block block_;
  std::vector<Eigen::Vector3d> recent_up_, recent_rate_;  // the last three blocks: direction of gravity, mean rate
  double predicted_square_ = 0.0, predicted_observed_ = 0.0;
  int turns_ = 0;
};

}  // namespace cocalib
