#pragma once

#include <gtest/gtest.h>

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/ros/conversions.h"
#include "cocalib/ros/point_cloud_reader.h"
#include "ros/point_cloud_builder.h"

namespace cocalib::test {

using sensor_msgs::PointCloud2;
using sensor_msgs::PointField;

const TimeNs kHeader = toTimeNs(kStamp);

inline PointCloudReader makeReader(const PointTimeOverride& time_override = {}) {
  return PointCloudReader(time_override, 0.5, 100.0, kPeriod_s);
}

/// Checks every point of the scan against the sweep it was written from.
inline void expectScan(const std::optional<LidarScan>& scan, const std::vector<Return>& sweep, TimeNs first_point,
                       double time_tolerance_s, bool rings = true) {
  ASSERT_TRUE(scan.has_value());
  ASSERT_EQ(scan->points.size(), sweep.size());
  EXPECT_NEAR(toSeconds(scan->stamp - first_point), 0.0, time_tolerance_s);
  for (std::size_t i = 0; i < sweep.size(); ++i) {
    const LidarPoint& point = scan->points[i];
    ASSERT_EQ(point.p, sweep[i].p);
    ASSERT_GE(point.offset_s, 0.0F);
    ASSERT_NEAR(toSeconds(scan->stamp - first_point) + static_cast<double>(point.offset_s), sweep[i].time_s,
                time_tolerance_s);
    if (rings) {
      ASSERT_EQ(point.ring, sweep[i].ring);
    }
  }
}

struct Dialect {
  std::string name;
  std::function<CloudBuilder()> fields;
  std::function<std::vector<double>(const Return&)> values;  // of a return whose sweep starts at the header stamp
  double tolerance_s;
};

const double kStamp_s = kStamp.toSec();

// Tolerances: a unit of the last place of the number written, plus float32 for the offset (7e-9 at 0.1 s).
const std::vector<Dialect> kDialects = {
    {"VelodyneFloatSeconds",
     [] {
       return CloudBuilder()
           .field("intensity", PointField::FLOAT32)
           .field("ring", PointField::UINT16)
           .field("time", PointField::FLOAT32);
     },
     [](const Return& r) {
       return std::vector<double>{17.0, r.ring * 1.0, r.time_s};
     },
     2e-8},
    {"OusterNanoseconds",
     [] {
       return CloudBuilder()
           .padding(4)
           .field("intensity", PointField::FLOAT32)
           .field("t", PointField::UINT32)
           .field("reflectivity", PointField::UINT16)
           .field("ring", PointField::UINT8)
           .padding(1)
           .field("ambient", PointField::UINT16)
           .padding(2)
           .field("range", PointField::UINT32)
           .padding(12);
     },
     [](const Return& r) { return std::vector<double>{17.0, r.time_s * 1e9, 3.0, r.ring * 1.0, 4.0, 5000.0}; }, 2e-8},
    {"HesaiAbsoluteSeconds",
     [] {
       return CloudBuilder()
           .field("intensity", PointField::FLOAT32)
           .field("timestamp", PointField::FLOAT64)
           .field("ring", PointField::UINT16);
     },
     [](const Return& r) {
       return std::vector<double>{17.0, kStamp_s + r.time_s, r.ring * 1.0};
     },
     6e-7},
    {"LivoxAbsoluteNanoseconds",
     [] {
       return CloudBuilder()
           .field("intensity", PointField::FLOAT32)
           .field("tag", PointField::UINT8)
           .field("line", PointField::UINT8)
           .field("timestamp", PointField::FLOAT64);
     },
     [](const Return& r) {
       return std::vector<double>{17.0, 16.0, r.ring * 1.0, (kStamp_s + r.time_s) * 1e9};
     },
     1e-6},
    {"LivoxOffsetTime",
     [] { return CloudBuilder().field("offset_time", PointField::UINT32).field("line", PointField::UINT8); },
     [](const Return& r) {
       return std::vector<double>{r.time_s * 1e9, r.ring * 1.0};
     },
     2e-8},
    {"MicrosecondsUnsigned",
     [] { return CloudBuilder().field("time", PointField::UINT32).field("channel", PointField::UINT16); },
     [](const Return& r) {
       return std::vector<double>{r.time_s * 1e6, r.ring * 1.0};
     },
     1.1e-6},
    {"MicrosecondsFloat",
     [] { return CloudBuilder().field("t", PointField::FLOAT32).field("ring", PointField::UINT16); },
     [](const Return& r) {
       return std::vector<double>{r.time_s * 1e6, r.ring * 1.0};
     },
     2e-8},
    {"NanosecondsFloat64",
     [] { return CloudBuilder().field("timestamp", PointField::FLOAT64).field("ring", PointField::UINT16); },
     [](const Return& r) {
       return std::vector<double>{r.time_s * 1e9, r.ring * 1.0};
     },
     2e-8},
    {"MillisecondsFloat",
     [] { return CloudBuilder().field("time_offset", PointField::FLOAT32).field("ring", PointField::UINT16); },
     [](const Return& r) {
       return std::vector<double>{r.time_s * 1e3, r.ring * 1.0};
     },
     2e-8},
};

inline PointCloud2 write(const Dialect& dialect, const std::vector<Return>& sweep, double shift_s = 0.0) {
  CloudBuilder builder = dialect.fields();
  for (Return r : sweep) {
    r.time_s += shift_s;
    builder.point(r.p, dialect.values(r));
  }
  return builder.build();
}

}  // namespace cocalib::test
