#pragma once

#include <deque>
#include <optional>

#include "cocalib/measurements/measurements.h"
#include "cocalib/measurements/stamp_order.h"

namespace cocalib {

/// Keyframes of both sensors that wait for each other.
struct KeyframeQueues {
  std::deque<VisualKeyframe> visual;
  std::deque<LidarKeyframe> lidar;
  StampOrder visual_order, lidar_order;

  /// @return false, and nothing done, if it does not come after the one before: the same data must not count twice
  bool add(VisualKeyframe keyframe);
  bool add(LidarKeyframe keyframe);

  /// Forgets keyframes more than `seconds` older than the newest of the same sensor. @return how many
  std::size_t forgetOlderThan(double seconds);

  /// IMU time up to which every sensor of the rig has delivered; nothing while one has not.
  /// @param camera_offset_s, lidar_offset_s  clock offsets; nothing: the rig has no such sensor
  std::optional<TimeNs> horizon(std::optional<double> camera_offset_s, std::optional<double> lidar_offset_s) const;

  /// Forgets what waits; later keyframes must still come after it.
  void drop();
  void clear();
};

}  // namespace cocalib
