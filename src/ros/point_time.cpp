#include "cocalib/ros/point_time.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace cocalib {
namespace {

using Origin = PointTimeDialect::Origin;
using Stamp = PointTimeDialect::Stamp;

constexpr double kMaxSweep_s = 1.5;       // no lidar takes longer for one cloud
constexpr double kSameClock_s = 1.0;      // point times further than this from the stamp are on another clock
constexpr double kEpochFrom_s = 1e9;      // 2001
constexpr double kEpochTo_s = 9e9;        // 2255: 64-bit nanoseconds hold it
constexpr std::size_t kManyPoints = 100;  // enough to see how long a sweep takes
constexpr std::array<double, 4> kUnits_s = {1.0, 1e-3, 1e-6, 1e-9};

/// Smallest and largest but for one percent at either end, which may be rubbish.
struct Bulk {
  double low = 0.0;
  double high = 0.0;
  std::size_t count = 0;
};

Bulk findBulk(const std::vector<double>& raw_times) {
  std::vector<double> finite;
  finite.reserve(raw_times.size());
  std::copy_if(raw_times.begin(), raw_times.end(), std::back_inserter(finite),
               [](double t) { return std::isfinite(t); });
  Bulk bulk;
  bulk.count = finite.size();
  if (finite.empty()) return bulk;
  const auto at = [&finite](std::size_t rank) {
    std::nth_element(finite.begin(), finite.begin() + static_cast<std::ptrdiff_t>(rank), finite.end());
    return finite[rank];
  };
  const std::size_t margin = finite.size() / 100;
  bulk.low = at(margin);
  bulk.high = at(finite.size() - 1 - margin);
  return bulk;
}

/// Unit in which the number is a date of this age.
std::optional<double> epochUnit(double value) {
  for (const double unit_s : kUnits_s) {
    if (value * unit_s >= kEpochFrom_s && value * unit_s < kEpochTo_s) return unit_s;
  }
  return std::nullopt;
}

/// Unit that the drivers with such a field use.
std::optional<double> customaryUnit(const std::string& field, const std::string& type) {
  if ((field == "t" || field == "offset_time" || field == "time_offset_ns") && type == "uint32") return 1e-9;
  if (field == "time" && type == "float32") return 1.0;
  return std::nullopt;
}

/// Unit in which the span is that of a sweep.
double spanUnit(double span) {
  if (span < 2.0) return 1.0;
  if (span < 2e3) return 1e-3;
  return span < 2e6 ? 1e-6 : 1e-9;
}

double chooseUnit(const Bulk& bulk, const std::string& field, const std::string& type) {
  const double span = bulk.high - bulk.low;
  const std::optional<double> customary = customaryUnit(field, type);
  const bool few = bulk.count < kManyPoints;
  if (customary && span * *customary <= kMaxSweep_s && (few || span * *customary > 1e-3)) return *customary;
  return spanUnit(span);
}

/// Seconds or their fractions on an absolute clock -> nanoseconds, without the rounding of a product.
TimeNs absoluteNs(double raw, double unit_s) {
  const double per_second = std::round(1.0 / unit_s);
  const double whole = std::floor(raw / per_second);
  const double rest = raw - whole * per_second;
  return static_cast<TimeNs>(whole) * 1'000'000'000 + toNs(rest * unit_s);
}

}  // namespace

std::optional<double> timeUnitSeconds(const std::string& unit) {
  if (unit == "s") return 1.0;
  if (unit == "ms") return 1e-3;
  if (unit == "us") return 1e-6;
  if (unit == "ns") return 1e-9;
  return std::nullopt;
}

PointTimeDialect recognisePointTimes(const std::vector<double>& raw_times, TimeNs header_stamp,
                                     const std::string& field, const std::string& type,
                                     const PointTimeOverride& time_override) {
  PointTimeDialect dialect;
  if (time_override.stamp == "first") dialect.stamp = Stamp::kFirst;
  if (time_override.stamp == "last") dialect.stamp = Stamp::kLast;

  const Bulk bulk = findBulk(raw_times);
  if (bulk.count == 0 || bulk.high <= bulk.low) return dialect;

  const std::optional<double> epoch_unit = epochUnit(bulk.low);
  dialect.unit_s = epoch_unit ? *epoch_unit : chooseUnit(bulk, field, type);
  if (!time_override.unit.empty()) dialect.unit_s = timeUnitSeconds(time_override.unit).value_or(dialect.unit_s);

  if ((bulk.high - bulk.low) * dialect.unit_s > kMaxSweep_s) return dialect;
  const double low_s = bulk.low * dialect.unit_s;
  if (std::abs(low_s) <= kMaxSweep_s) {
    dialect.origin = Origin::kStamp;
  } else {
    const bool same_clock = std::abs(low_s - toSeconds(header_stamp)) <= kSameClock_s;
    dialect.origin = same_clock ? Origin::kAbsolute : Origin::kOwnClock;
  }
  return dialect;
}

std::optional<std::size_t> applyPointTimes(const PointTimeDialect& dialect, TimeNs header_stamp,
                                           const std::vector<double>& raw_times, LidarScan* scan,
                                           std::string* problem) {
  // Differences to a point of the cloud keep every digit of an absolute time; the middle one is as good as any.
  std::vector<LidarPoint>& points = scan->points;
  const double reference = dialect.origin == Origin::kStamp ? 0.0 : raw_times[raw_times.size() / 2];
  double first_s = std::numeric_limits<double>::infinity();
  double last_s = -first_s;
  std::size_t kept = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double time_s = (raw_times[i] - reference) * dialect.unit_s;
    if (!(std::abs(time_s) <= kMaxSweep_s)) continue;
    first_s = std::min(first_s, time_s);
    last_s = std::max(last_s, time_s);
    points[kept] = points[i];
    points[kept].offset_s = static_cast<float>(time_s);
    ++kept;
  }
  const std::size_t removed = points.size() - kept;
  if (dialect.origin == Origin::kAbsolute &&
      !(std::abs(reference * dialect.unit_s - toSeconds(header_stamp)) <= kSameClock_s + kMaxSweep_s)) {
    *problem = "point times have left the clock of the header stamps";
    return std::nullopt;
  }
  if (kept == 0 || removed > points.size() / 2 || last_s - first_s > kMaxSweep_s) {
    *problem = "point times make no sweep of at most 1.5 s; give field, unit and stamp under lidar: point_time";
    return std::nullopt;
  }
  points.resize(kept);

  const auto first_float = static_cast<float>(first_s);
  for (LidarPoint& point : points) point.offset_s -= first_float;
  if (dialect.stamp == Stamp::kLast) {
    scan->stamp = header_stamp - toNs(last_s - first_s);
  } else if (dialect.stamp == Stamp::kFirst || dialect.origin == Origin::kOwnClock) {
    scan->stamp = header_stamp;
  } else if (dialect.origin == Origin::kStamp) {
    scan->stamp = header_stamp + toNs(first_s);
  } else {
    scan->stamp = absoluteNs(reference, dialect.unit_s) + toNs(first_s);
  }
  return removed;
}

}  // namespace cocalib
