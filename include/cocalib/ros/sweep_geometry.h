#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// What the azimuths say of a sweep.
enum class SweepKind {
  kClockwise,  ///< seen from above
  kCounterclockwise,
  kUnordered,   ///< all around, but the order of the points shows no direction: taken as clockwise, as most lidars turn
  kNotSpinning  ///< less than a third of the circle: no times can be had from it
};

/// Computes offset_s of every point from its azimuth, for a lidar that turns about its z axis once in `period_s`, and
/// moves the scan's stamp from the first point of the cloud to the earliest one (lasers of one firing differ by
/// degrees). Points in firing order may cover more than one turn; points ring by ring start at the azimuth of the
/// first. kNotSpinning: all offsets are zero.
/// @pre the cloud's first point was fired at scan->stamp
SweepKind timesFromAzimuth(double period_s, LidarScan* scan);

/// Laser number from the elevation, for clouds that do not say it.
class RingTable {
 public:
  /// Finds the elevations at which the points of one cloud gather; nothing if they do not (solid-state lidars, clouds
  /// in another frame).
  static std::optional<RingTable> build(const std::vector<LidarPoint>& points);

  /// Number of the laser, 0 the lowest; -1 if the point lies between two.
  std::int16_t ring(const Eigen::Vector3f& p) const;
  int count() const { return count_; }

 private:
  std::vector<std::int16_t> by_sine_;  // over sin(elevation) from -1 to 1 in equal steps
  int count_ = 0;
};

}  // namespace cocalib
