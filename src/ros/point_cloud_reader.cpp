#include "cocalib/ros/point_cloud_reader.h"

#include <cmath>
#include <cstring>
#include <limits>
#include <utility>

#include "cocalib/ros/conversions.h"

namespace cocalib {
namespace {

using Origin = PointTimeDialect::Origin;
using Stamp = PointTimeDialect::Stamp;

std::string unitName(double unit_s) {
  if (unit_s == 1.0) return "s";
  if (unit_s == 1e-3) return "ms";
  return unit_s == 1e-6 ? "us" : "ns";
}

std::string describeOrigin(const PointTimeDialect& dialect) {
  std::string text;
  if (dialect.origin == Origin::kStamp) text = "counted from the header stamp";
  if (dialect.origin == Origin::kAbsolute) text = "absolute, on the clock of the header stamp";
  if (dialect.origin == Origin::kOwnClock) text = "on another clock than the header stamp";
  if (dialect.stamp == Stamp::kLast) return text + "; the header stamp is the last point's";
  if (dialect.stamp == Stamp::kFirst || dialect.origin == Origin::kOwnClock) {
    return text + "; the header stamp is the first point's";
  }
  return text;
}

std::string describeSweep(SweepKind kind, double period_s) {
  switch (kind) {
    case SweepKind::kClockwise:
      return "computed from the azimuth, clockwise, " + std::to_string(period_s) + " s a turn";
    case SweepKind::kCounterclockwise:
      return "computed from the azimuth, counter-clockwise, " + std::to_string(period_s) + " s a turn";
    case SweepKind::kUnordered:
      return "computed from the azimuth, clockwise (a guess: the points are in no order), " + std::to_string(period_s) +
             " s a turn";
    case SweepKind::kNotSpinning:
      break;
  }
  return "unknown: all points count as taken at the header stamp";
}

float loadFloat(const std::uint8_t* bytes) {
  float value;
  std::memcpy(&value, bytes, sizeof(value));
  return value;
}

}  // namespace

PointCloudReader::PointCloudReader(const RigConfig::Lidar& lidar)
    : PointCloudReader(lidar.point_time, lidar.min_range_m, lidar.max_range_m, lidar.scan_period_s) {}

PointCloudReader::PointCloudReader(PointTimeOverride time_override, double min_range_m, double max_range_m,
                                   double scan_period_s)
    : time_override_(std::move(time_override)),
      min_range_m_(min_range_m),
      max_range_m_(max_range_m),
      scan_period_s_(scan_period_s) {}

std::optional<LidarScan> PointCloudReader::read(const sensor_msgs::PointCloud2& msg, std::string* problem) {
  std::string ignored;
  if (problem == nullptr) problem = &ignored;
  if (!checkCloudSize(msg, problem)) return std::nullopt;
  if (msg.header.stamp.isZero()) {
    *problem = "cloud has no stamp";
    return std::nullopt;
  }
  if (!layout_ || !layout_->fits(msg)) {
    layout_ = findPointLayout(msg, time_override_.field, problem);
    dialect_.reset();
    rings_.reset();
    if (!layout_) return std::nullopt;
  }

  LidarScan scan;
  scan.stamp = toTimeNs(msg.header.stamp);
  parsePoints(msg, &scan);
  if (scan.points.empty()) {
    *problem = "no point of the cloud is finite and within " + std::to_string(min_range_m_) + " to " +
               std::to_string(max_range_m_) + " m";
    return std::nullopt;
  }
  if (!dialect_ && !recognise(scan, problem)) return std::nullopt;
  if (rings_) {
    for (LidarPoint& point : scan.points) point.ring = rings_->ring(point.p);
  }
  if (!applyTimes(&scan, problem)) return std::nullopt;
  return scan;
}

/// Points within range, their rings and raw times; what the sizes allow has been checked before.
void PointCloudReader::parsePoints(const sensor_msgs::PointCloud2& msg, LidarScan* scan) {
  const std::size_t claimed = std::size_t{msg.width} * msg.height;  // backed by data: checkCloudSize()
  scan->points.reserve(claimed);
  raw_times_.clear();
  if (layout_->time) raw_times_.reserve(claimed);

  const auto min2 = static_cast<float>(min_range_m_ * min_range_m_);
  const auto max2 = static_cast<float>(max_range_m_ * max_range_m_);
  for (std::size_t row = 0; row < msg.height; ++row) {
    const std::uint8_t* bytes = msg.data.data() + row * msg.row_step;
    for (std::size_t column = 0; column < msg.width; ++column, bytes += msg.point_step) {
      LidarPoint point;
      point.p << loadFloat(bytes + layout_->x), loadFloat(bytes + layout_->y), loadFloat(bytes + layout_->z);
      const float range2 = point.p.squaredNorm();
      if (!(range2 >= min2 && range2 <= max2 && range2 > 0.0F)) continue;  // NaN and infinity too
      if (layout_->ring) {
        const double ring = layout_->ring->read(bytes);
        if (ring >= 0.0 && ring <= std::numeric_limits<std::int16_t>::max()) {
          point.ring = static_cast<std::int16_t>(ring);
        }
      }
      if (layout_->time) raw_times_.push_back(layout_->time->read(bytes));
      scan->points.push_back(point);
    }
  }
  dropped_points_ += claimed - scan->points.size();
}

/// Settles, with the numbers of this cloud, how times and rings are read from now on.
bool PointCloudReader::recognise(const LidarScan& scan, std::string* problem) {
  PointTimeDialect dialect;
  if (layout_->time) {
    dialect = recognisePointTimes(raw_times_, scan.stamp, layout_->time->name, pointTypeName(layout_->time->datatype),
                                  time_override_);
    if (dialect.origin == Origin::kNone && !time_override_.field.empty()) {
      *problem = "field '" + layout_->time->name + "', which the rig file names as the points' time, makes no sweep" +
                 (time_override_.unit.empty() ? "" : " in " + time_override_.unit);
      return false;
    }
  } else if (time_override_.stamp == "last") {
    dialect.stamp = Stamp::kLast;
  }
  dialect_ = dialect;
  if (!layout_->ring) rings_ = RingTable::build(scan.points);
  description_.clear();  // said anew with the next good scan
  return true;
}

bool PointCloudReader::applyTimes(LidarScan* scan, std::string* problem) {
  if (dialect_->origin == Origin::kNone) {
    const TimeNs header_stamp = scan->stamp;
    const SweepKind kind = timesFromAzimuth(scan_period_s_, scan);
    if (dialect_->stamp == Stamp::kLast) {
      float last_s = 0.0F;
      for (const LidarPoint& point : scan->points) last_s = std::max(last_s, point.offset_s);
      scan->stamp = header_stamp - toNs(static_cast<double>(last_s));
    }
    if (description_.empty()) describe(kind);
    return true;
  }
  const std::optional<std::size_t> removed = applyPointTimes(*dialect_, scan->stamp, raw_times_, scan, problem);
  if (!removed) {
    dialect_.reset();  // the next cloud may tell more
    return false;
  }
  dropped_points_ += *removed;
  if (description_.empty()) describe(std::nullopt);
  return true;
}

void PointCloudReader::describe(std::optional<SweepKind> sweep) {
  warning_.clear();
  description_ = "point times: ";
  if (sweep) {
    description_ += describeSweep(*sweep, scan_period_s_);
    warning_ =
        layout_->time ? "field '" + layout_->time->name + "' carries no usable times" : "cloud has no point times";
    warning_ += "; they are " + describeSweep(*sweep, scan_period_s_);
  } else {
    description_ += "field '" + layout_->time->name + "' (" + pointTypeName(layout_->time->datatype) + ", " +
                    unitName(dialect_->unit_s) + "), " + describeOrigin(*dialect_);
    if (dialect_->origin == Origin::kOwnClock && dialect_->stamp == Stamp::kAsCounted) {
      warning_ = "point times are " + describeOrigin(*dialect_) + " (lidar: point_time: stamp says otherwise)";
    }
  }
  description_ += "; rings: ";
  if (layout_->ring) {
    description_ += "field '" + layout_->ring->name + "'";
    return;
  }
  const std::string rings = rings_ ? std::to_string(rings_->count()) + " from the elevation" : std::string("unknown");
  description_ += rings;
  warning_ += (warning_.empty() ? "" : "; ") + ("cloud has no ring numbers; rings: " + rings);
}

}  // namespace cocalib
