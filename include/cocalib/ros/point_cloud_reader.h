#pragma once

#include <sensor_msgs/PointCloud2.h>

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/io/rig_config.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/ros/point_layout.h"
#include "cocalib/ros/point_time.h"
#include "cocalib/ros/sweep_geometry.h"

namespace cocalib {

/// PointCloud2 as drivers publish it -> LidarScan. Which dialect it is (field of the time, its unit, absolute or
/// relative to the header stamp; field of the ring) is recognised at the first cloud by names, types and values, and
/// again when the fields change. Where a cloud has no time it is computed from the azimuth, where it has no ring from
/// the elevation. Points that are not finite or out of range are dropped and counted.
///
/// Nothing a message claims is believed before its data have been counted. One reader for one topic; not thread-safe.
class PointCloudReader {
 public:
  explicit PointCloudReader(const RigConfig::Lidar& lidar);
  /// @param override       what the user knows better; empty parts are recognised
  /// @param min_range_m    nearer points are dropped (returns from the robot itself, zeros for "no return") [m]
  /// @param max_range_m    farther points are dropped [m]
  /// @param scan_period_s  duration of one revolution, used only where the cloud carries no times [s]
  PointCloudReader(PointTimeOverride time_override, double min_range_m, double max_range_m, double scan_period_s);

  /// The scan, its stamp moved to its first point so that all offsets are >= 0; the order of the points is the
  /// driver's.
  /// @param problem  set, in one line, when nothing is returned; may be null. Never throws on bad data.
  std::optional<LidarScan> read(const sensor_msgs::PointCloud2& msg, std::string* problem);

  /// In plain words, how times and rings are read; empty before the first good cloud. Say it again when it changes.
  const std::string& description() const { return description_; }
  /// What the user should know of it (times or rings had to be computed, another clock); empty: nothing.
  const std::string& warning() const { return warning_; }
  /// Points dropped so far because they were not finite, out of range or without a believable time.
  std::uint64_t droppedPoints() const { return dropped_points_; }

 private:
  void parsePoints(const sensor_msgs::PointCloud2& msg, LidarScan* scan);
  bool recognise(const LidarScan& scan, std::string* problem);
  bool applyTimes(LidarScan* scan, std::string* problem);
  void describe(std::optional<SweepKind> sweep);

  PointTimeOverride time_override_;
  double min_range_m_, max_range_m_, scan_period_s_;

  std::optional<PointLayout> layout_;        // of the fields seen last
  std::optional<PointTimeDialect> dialect_;  // nothing: not yet recognised
  std::optional<RingTable> rings_;           // only where the cloud has no ring
  std::vector<double> raw_times_;            // of the points kept, as the cloud gives them
  std::string description_, warning_;
  std::uint64_t dropped_points_ = 0;
};

}  // namespace cocalib
