// What the cloud reader says to clouds that lie.

#include <algorithm>
#include <functional>
#include <random>
#include <string>

#include "ros/point_cloud_dialects.h"

namespace cocalib {
namespace {

using namespace test;

TEST(DamagedCloud, SaysWhyItRefuses) {
  const PointCloud2 good = write(kDialects[0], makeSweep(100));
  const auto refusal = [&good](const std::function<void(PointCloud2*)>& spoil) {
    PointCloud2 msg = good;
    spoil(&msg);
    PointCloudReader reader = makeReader();
    std::string problem;
    EXPECT_FALSE(reader.read(msg, &problem));
    EXPECT_EQ(problem.find('\n'), std::string::npos);
    return problem;
  };
  const auto says = [&](const std::function<void(PointCloud2*)>& spoil, const std::string& word) {
    const std::string problem = refusal(spoil);
    EXPECT_NE(problem.find(word), std::string::npos) << problem;
  };
  says([](PointCloud2* m) { m->width = 0; }, "empty");
  says([](PointCloud2* m) { m->data.clear(); }, "has 0");
  says([](PointCloud2* m) { m->data.pop_back(); }, "claims");
  says([](PointCloud2* m) { m->width = 0xFFFFFFFF; }, "claims");
  says([](PointCloud2* m) { m->height = 0xFFFFFFFF; }, "claims");
  says([](PointCloud2* m) { m->width = m->height = m->row_step = 0xFFFFFFFF; }, "claims");
  says(
      [](PointCloud2* m) {
        m->height = 2;
        m->row_step = 1;
      },
      "claims rows");
  says([](PointCloud2* m) { m->point_step = 0; }, "points of 0 bytes");
  says([](PointCloud2* m) { m->point_step = 0xFFFFFFFF; }, "bytes");
  says([](PointCloud2* m) { m->is_bigendian = 1; }, "big-endian");
  says([](PointCloud2* m) { m->fields.clear(); }, "no field 'x'");
  says([](PointCloud2* m) { m->fields[1].name = "Y"; }, "no field 'y'");
  says([](PointCloud2* m) { m->fields[0].datatype = PointField::FLOAT64; }, "float64");
  says([](PointCloud2* m) { m->fields[0].datatype = 77; }, "type 77");
  says([](PointCloud2* m) { m->fields[2].offset = 0xFFFFFFFE; }, "ends at byte");
  says([](PointCloud2* m) { m->fields[4].offset = m->point_step - 1; }, "ends at byte");
  says([](PointCloud2* m) { m->fields[5].offset = m->point_step - 3; }, "ends at byte");
  says([](PointCloud2* m) { m->fields[5].count = 1000; }, "array");
  says([](PointCloud2* m) { m->header.stamp = ros::Time(); }, "no stamp");
  says([](PointCloud2* m) { std::fill(m->data.begin(), m->data.end(), 0xFF); }, "finite");
}

// Whatever bytes and claims come, the reader answers; run under a sanitizer this finds reads out of bounds.
TEST(DamagedCloud, SurvivesRandomDamage) {
  std::mt19937 random(11);
  const auto upTo = [&random](std::uint32_t n) { return std::uniform_int_distribution<std::uint32_t>(0, n)(random); };
  const std::vector<Return> sweep = makeSweep(20);
  int read = 0;
  for (int trial = 0; trial < 3000; ++trial) {
    PointCloud2 msg = write(kDialects[upTo(8)], sweep);
    for (std::uint32_t change = upTo(3); change > 0; --change) {
      PointField& field = msg.fields[upTo(static_cast<std::uint32_t>(msg.fields.size() - 1))];
      switch (upTo(8)) {
        case 0:
          msg.width = upTo(2000);
          break;
        case 1:
          msg.height = upTo(20);
          break;
        case 2:
          msg.point_step = upTo(64);
          break;
        case 3:
          msg.row_step = upTo(20000);
          break;
        case 4:
          msg.data.resize(upTo(20000));
          break;
        case 5:
          field.offset = upTo(64);
          break;
        case 6:
          field.datatype = static_cast<std::uint8_t>(upTo(10));
          break;
        default:
          for (std::size_t i = 0; i < msg.data.size() / 3; ++i) {
            msg.data[upTo(static_cast<std::uint32_t>(msg.data.size() - 1))] = static_cast<std::uint8_t>(upTo(255));
          }
      }
    }
    PointCloudReader reader = makeReader();
    std::string problem;
    const std::optional<LidarScan> scan = reader.read(msg, &problem);
    EXPECT_NE(scan.has_value(), !problem.empty());
    if (!scan) continue;
    ++read;
    for (const LidarPoint& point : scan->points) {
      ASSERT_TRUE(point.p.allFinite());
      ASSERT_TRUE(point.offset_s >= 0.0F && point.offset_s <= 3.1F);
    }
  }
  EXPECT_GT(read, 500);
}

}  // namespace
}  // namespace cocalib
