#include "cocalib/ros/point_cloud_writer.h"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numeric>
#include <vector>

namespace cocalib {
namespace {

using sensor_msgs::PointField;

enum class Quantity { kX, kY, kZ, kIntensity, kRing, kOffset_s, kOffset_ns, kStamp_s, kStamp_ns, kRange_mm, kZero };

struct FieldAt {
  const char* name;
  Quantity quantity;
  std::uint32_t offset;
  std::uint8_t type;
};

struct Layout {
  std::vector<FieldAt> fields;
  std::uint32_t point_step;
};

// Offsets and steps are those of the drivers' own point types, padding included.
Layout layoutOf(CloudLayout layout) {
  constexpr std::uint8_t kF32 = PointField::FLOAT32, kF64 = PointField::FLOAT64, kU8 = PointField::UINT8,
                         kU16 = PointField::UINT16, kU32 = PointField::UINT32;
  const std::vector<FieldAt> xyz = {
      {"x", Quantity::kX, 0, kF32}, {"y", Quantity::kY, 4, kF32}, {"z", Quantity::kZ, 8, kF32}};
  Layout result{xyz, 0};
  const auto add = [&](std::initializer_list<FieldAt> fields, std::uint32_t step) {
    result.fields.insert(result.fields.end(), fields);
    result.point_step = step;
  };
  switch (layout) {
    case CloudLayout::kVelodyne:
      add({{"intensity", Quantity::kIntensity, 12, kF32},
           {"ring", Quantity::kRing, 16, kU16},
           {"time", Quantity::kOffset_s, 18, kF32}},
          22);
      break;
    case CloudLayout::kOuster:
      add({{"intensity", Quantity::kIntensity, 16, kF32},
           {"t", Quantity::kOffset_ns, 20, kU32},
           {"reflectivity", Quantity::kIntensity, 24, kU16},
           {"ring", Quantity::kRing, 26, kU16},
           {"ambient", Quantity::kZero, 28, kU16},
           {"range", Quantity::kRange_mm, 32, kU32}},
          48);
      break;
    case CloudLayout::kHesai:
      add({{"intensity", Quantity::kIntensity, 16, kF32},
           {"timestamp", Quantity::kStamp_s, 24, kF64},
           {"ring", Quantity::kRing, 32, kU16}},
          48);
      break;
    case CloudLayout::kRobosense:
      add({{"intensity", Quantity::kIntensity, 12, kF32},
           {"ring", Quantity::kRing, 16, kU16},
           {"timestamp", Quantity::kStamp_s, 18, kF64}},
          26);
      break;
    case CloudLayout::kLivox:
      add({{"intensity", Quantity::kIntensity, 12, kF32},
           {"tag", Quantity::kZero, 16, kU8},
           {"line", Quantity::kRing, 17, kU8},
           {"timestamp", Quantity::kStamp_ns, 18, kF64}},
          26);
      break;
    case CloudLayout::kLivoxOffset:
      add({{"intensity", Quantity::kIntensity, 12, kF32},
           {"tag", Quantity::kZero, 16, kU8},
           {"line", Quantity::kRing, 17, kU8},
           {"offset_time", Quantity::kOffset_ns, 18, kU32}},
          22);
      break;
    case CloudLayout::kNoTime:
      add({{"intensity", Quantity::kIntensity, 12, kF32}}, 16);
      break;
  }
  return result;
}

double valueOf(Quantity quantity, const LidarPoint& point, TimeNs stamp) {
  const double offset_ns = std::round(point.offset_s * 1e9);
  // Nanoseconds of today fit a double only to 256 ns, seconds to 238 ns. It is what the drivers send.
  const auto absolute_ns = static_cast<double>(stamp + static_cast<TimeNs>(offset_ns));
  const double range = point.p.allFinite() ? point.p.norm() : 0.0;
  switch (quantity) {
    case Quantity::kX:
      return point.p.x();
    case Quantity::kY:
      return point.p.y();
    case Quantity::kZ:
      return point.p.z();
    case Quantity::kIntensity:
      return range > 0.0 ? std::round(255.0 / (1.0 + 0.1 * range)) : 0.0;
    case Quantity::kRing:
      return point.ring;
    case Quantity::kOffset_s:
      return point.offset_s;
    case Quantity::kOffset_ns:
      return offset_ns;
    case Quantity::kStamp_s:
      return 1e-9 * absolute_ns;
    case Quantity::kStamp_ns:
      return absolute_ns;
    case Quantity::kRange_mm:
      return std::round(1e3 * range);
    case Quantity::kZero:
      break;
  }
  return 0.0;
}

template <typename T>
void put(std::uint8_t* target, double value) {
  const T typed = static_cast<T>(value);
  std::memcpy(target, &typed, sizeof(T));
}

void putField(std::uint8_t* target, std::uint8_t type, double value) {
  switch (type) {
    case PointField::FLOAT64:
      return put<double>(target, value);
    case PointField::UINT32:
      return put<std::uint32_t>(target, value);
    case PointField::UINT16:
      return put<std::uint16_t>(target, value);
    case PointField::UINT8:
      return put<std::uint8_t>(target, value);
    default:
      return put<float>(target, value);
  }
}

// Points by ring, each ring in the order of firing.
std::vector<LidarPoint> byRing(std::vector<LidarPoint> points) {
  std::stable_sort(points.begin(), points.end(),
                   [](const LidarPoint& a, const LidarPoint& b) { return a.ring < b.ring; });
  for (LidarPoint& point : points) {
    if (!point.p.allFinite()) point.p.setZero();
  }
  return points;
}

// Rows of an organised cloud: the number of rings if all have equally many points, otherwise 1.
std::uint32_t rowsOf(const std::vector<LidarPoint>& points_by_ring) {
  if (points_by_ring.empty()) return 1;
  const std::size_t rings = static_cast<std::size_t>(points_by_ring.back().ring) + 1;
  if (points_by_ring.size() % rings != 0) return 1;
  const std::size_t columns = points_by_ring.size() / rings;
  for (std::size_t i = 0; i < points_by_ring.size(); ++i) {
    if (static_cast<std::size_t>(points_by_ring[i].ring) != i / columns) return 1;
  }
  return static_cast<std::uint32_t>(rings);
}

}  // namespace

sensor_msgs::PointCloud2 toPointCloud2(const LidarScan& scan, CloudLayout layout, const std::string& frame) {
  const Layout format = layoutOf(layout);
  const bool organised = layout == CloudLayout::kOuster;
  const std::vector<LidarPoint> points = organised ? byRing(scan.points) : scan.points;

  sensor_msgs::PointCloud2 cloud;
  cloud.header.stamp.fromNSec(static_cast<std::uint64_t>(scan.stamp));
  cloud.header.frame_id = frame;
  for (const FieldAt& field : format.fields) {
    PointField message;
    message.name = field.name;
    message.offset = field.offset;
    message.datatype = field.type;
    message.count = 1;
    cloud.fields.push_back(message);
  }
  cloud.height = organised ? rowsOf(points) : 1;
  cloud.width = static_cast<std::uint32_t>(points.size()) / cloud.height;
  cloud.point_step = format.point_step;
  cloud.row_step = cloud.point_step * cloud.width;
  cloud.is_dense = static_cast<std::uint8_t>(
      std::all_of(points.begin(), points.end(), [](const LidarPoint& point) { return point.p.allFinite(); }));
  cloud.data.assign(static_cast<std::size_t>(cloud.row_step) * cloud.height, 0);
  std::uint8_t* target = cloud.data.data();
  for (const LidarPoint& point : points) {
    for (const FieldAt& field : format.fields) {
      putField(target + field.offset, field.type, valueOf(field.quantity, point, scan.stamp));
    }
    target += format.point_step;
  }
  return cloud;
}

}  // namespace cocalib
