// PointCloud2 with any sizes, fields and bytes; two clouds in a row, because the reader remembers the first one's
// layout.

#include <fuzzer/FuzzedDataProvider.h>

#include <cmath>

#include "cocalib/ros/point_cloud_reader.h"
#include "expect.h"

namespace {

/// Sizes that are near the truth more often than not, so that the fuzzer gets past the first check.
std::uint32_t size(FuzzedDataProvider* bytes) {
  return bytes->ConsumeBool() ? bytes->ConsumeIntegralInRange<std::uint32_t>(0, 64)
                              : bytes->ConsumeIntegral<std::uint32_t>();
}

sensor_msgs::PointCloud2 cloud(FuzzedDataProvider* bytes) {
  static const char* const kNames[] = {"x",         "y",           "z",    "time", "t",
                                       "timestamp", "offset_time", "ring", "line", "intensity"};
  sensor_msgs::PointCloud2 msg;
  msg.header.stamp.sec = bytes->ConsumeIntegral<std::uint32_t>();
  msg.header.stamp.nsec = bytes->ConsumeIntegral<std::uint32_t>();
  msg.is_bigendian = bytes->ConsumeIntegralInRange(0, 15) == 0;
  msg.is_dense = bytes->ConsumeBool();
  msg.width = size(bytes);
  msg.height = bytes->ConsumeBool() ? 1 : size(bytes);
  msg.point_step = size(bytes);
  const bool honest = bytes->ConsumeBool();
  msg.row_step = honest ? msg.width * msg.point_step : size(bytes);
  const int fields = bytes->ConsumeIntegralInRange(0, 8);
  for (int i = 0; i < fields; ++i) {
    sensor_msgs::PointField field;
    field.name = bytes->ConsumeIntegralInRange(0, 31) == 0 ? bytes->ConsumeRandomLengthString(8)
                                                           : std::string(bytes->PickValueInArray(kNames));
    field.offset = size(bytes);
    field.datatype = i < 3 && bytes->ConsumeBool() ? 7 : bytes->ConsumeIntegralInRange<std::uint8_t>(0, 10);
    field.count = bytes->ConsumeBool() ? 1 : size(bytes);
    msg.fields.push_back(field);
  }
  const auto length = bytes->ConsumeIntegralInRange<std::size_t>(0, bytes->remaining_bytes());
  msg.data = bytes->ConsumeBytes<std::uint8_t>(length);
  return msg;
}

void expectSound(const cocalib::LidarScan& scan) {
  EXPECT_ALWAYS(!scan.points.empty());
  for (const cocalib::LidarPoint& point : scan.points) {
    EXPECT_ALWAYS(point.p.allFinite());
    EXPECT_ALWAYS(point.offset_s >= 0.0F && point.offset_s < 2.0F);
    EXPECT_ALWAYS(point.ring >= -1);
  }
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t count) {
  static const char* const kFields[] = {"", "time", "t", "none", "ring"};
  static const char* const kUnits[] = {"", "s", "ms", "us", "ns"};
  static const char* const kStamps[] = {"", "first", "last"};
  FuzzedDataProvider bytes(data, count);
  cocalib::PointTimeOverride known;
  if (bytes.ConsumeBool()) {
    known.field = bytes.PickValueInArray(kFields);
    known.unit = bytes.PickValueInArray(kUnits);
    known.stamp = bytes.PickValueInArray(kStamps);
  }
  cocalib::PointCloudReader reader(known, 0.5, 100.0, 0.1);
  for (int i = 0; i < 2; ++i) {
    const sensor_msgs::PointCloud2 msg = cloud(&bytes);
    std::string problem;
    const auto scan = reader.read(msg, &problem);
    scan ? expectSound(*scan) : expectOneLine(problem);
  }
  return 0;
}
