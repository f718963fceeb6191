#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cocalib/geometry/time.h"
#include "cocalib/io/rig_config.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// How the time of a point is to be read.
struct PointTimeDialect {
  enum class Origin {
    kStamp,     ///< counted from the header stamp, forwards or backwards
    kAbsolute,  ///< on the header stamp's own clock
    kOwnClock,  ///< on another clock; only differences count
    kNone       ///< there is none: computed from the azimuth
  };
  enum class Stamp { kAsCounted, kFirst, kLast };

  Origin origin = Origin::kNone;
  double unit_s = 1.0;              ///< of the numbers in the cloud
  Stamp stamp = Stamp::kAsCounted;  ///< kFirst, kLast: the header stamp is the time of that point, whatever the numbers
};

/// "s", "ms", "us", "ns" -> seconds; nothing for another word.
std::optional<double> timeUnitSeconds(const std::string& unit);

/// Recognises the dialect from the numbers of one cloud.
///
/// Relative times of a sweep (2 ms to 1.5 s) span 0.002-1.5 in s, 2-1500 in ms, 2e3-1.5e6 in us, 2e6-1.5e9 in ns, so
/// the span names the unit; absolute ones (years 2001-2255) lie in 1e9-9e9 s, 1e12-9e12 ms, and so on, so their size
/// does. `field` and `type` decide where there are too few points for that (`t` in uint32 is always ns, say).
///
/// @param raw_times  of the points, as in the cloud, any order, may hold NaN
/// @return kNone if the numbers carry nothing (all equal, or no unit makes a sweep of them)
PointTimeDialect recognisePointTimes(const std::vector<double>& raw_times, TimeNs header_stamp,
                                     const std::string& field, const std::string& type,
                                     const PointTimeOverride& time_override);

/// Fills offset_s of every point and the scan's stamp (of its first point); points whose time is absurd are removed.
/// @param raw_times  one for each point
/// @return nothing, and one line in `problem`, if no sweep comes out; else the number of points removed
std::optional<std::size_t> applyPointTimes(const PointTimeDialect& dialect, TimeNs header_stamp,
                                           const std::vector<double>& raw_times, LidarScan* scan, std::string* problem);

}  // namespace cocalib
