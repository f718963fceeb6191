#include "cocalib/ros/point_cloud_reader.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <numeric>

#include "cocalib/ros/conversions.h"
#include "ros/point_cloud_builder.h"

namespace cocalib {
namespace {

using sensor_msgs::PointCloud2;
using sensor_msgs::PointField;
using test::CloudBuilder;
using test::kPi;
using test::kStamp;
using test::makeSweep;
using test::Return;

const TimeNs kHeader = toTimeNs(kStamp);

PointCloudReader makeReader(const PointTimeOverride& time_override = {}) {
  return PointCloudReader(time_override, 0.5, 100.0, test::kPeriod_s);
}

/// Checks every point of the scan against the sweep it was written from.
void expectScan(const std::optional<LidarScan>& scan, const std::vector<Return>& sweep, TimeNs first_point,
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

PointCloud2 write(const Dialect& dialect, const std::vector<Return>& sweep, double shift_s = 0.0) {
  CloudBuilder builder = dialect.fields();
  for (Return r : sweep) {
    r.time_s += shift_s;
    builder.point(r.p, dialect.values(r));
  }
  return builder.build();
}

class Dialects : public testing::TestWithParam<Dialect> {};

TEST_P(Dialects, StampAtTheFirstPoint) {
  PointCloudReader reader = makeReader();
  std::string problem;
  const std::vector<Return> sweep = makeSweep();
  expectScan(reader.read(write(GetParam(), sweep), &problem), sweep, kHeader, GetParam().tolerance_s);
  EXPECT_EQ(problem, "");
  EXPECT_NE(reader.description().find("point times: field '"), std::string::npos) << reader.description();
  EXPECT_EQ(reader.warning(), "");
  EXPECT_EQ(reader.droppedPoints(), 0U);
}

TEST_P(Dialects, LaterScansAreReadTheSameWayEvenWithFewPoints) {
  PointCloudReader reader = makeReader();
  const std::vector<Return> sweep = makeSweep();
  ASSERT_TRUE(reader.read(write(GetParam(), sweep), nullptr));
  const std::vector<Return> part(sweep.begin(), sweep.begin() + 40);
  expectScan(reader.read(write(GetParam(), part), nullptr), part, kHeader, GetParam().tolerance_s);
}

INSTANTIATE_TEST_SUITE_P(AsDriversWrite, Dialects, testing::ValuesIn(kDialects),
                         [](const auto& info) { return info.param.name; });

TEST(PointCloudReader, VelodyneStampAtTheLastPointCountsBackwards) {
  PointCloudReader reader = makeReader();
  const std::vector<Return> sweep = makeSweep();
  const double last_s = sweep.back().time_s;
  expectScan(reader.read(write(kDialects[0], sweep, -last_s), nullptr), sweep, kHeader - toNs(last_s), 2e-8);
}

TEST(PointCloudReader, AbsoluteTimesDoNotNeedTheStampAtEitherEnd) {
  PointCloudReader reader = makeReader();
  const std::vector<Return> sweep = makeSweep();
  expectScan(reader.read(write(kDialects[2], sweep, -0.07), nullptr), sweep, kHeader - toNs(0.07), 6e-7);
}

TEST(PointCloudReader, TimesOnAnotherClockCountFromTheHeaderStampAndAreWarnedOf) {
  PointCloudReader reader = makeReader();
  const std::vector<Return> sweep = makeSweep();
  expectScan(reader.read(write(kDialects[2], sweep, 37.0), nullptr), sweep, kHeader, 6e-7);  // TAI, say
  EXPECT_NE(reader.warning().find("another clock"), std::string::npos) << reader.warning();
}

TEST(PointCloudReader, LidarUptimeIsAnotherClockToo) {
  PointCloudReader reader = makeReader();
  CloudBuilder builder = CloudBuilder().field("timestamp", PointField::FLOAT64).field("ring", PointField::UINT16);
  const std::vector<Return> sweep = makeSweep();
  for (const Return& r : sweep) builder.point(r.p, {1234.5 + r.time_s, r.ring * 1.0});
  expectScan(reader.read(builder.build(), nullptr), sweep, kHeader, 2e-8);
  EXPECT_NE(reader.warning(), "");
}

TEST(PointCloudReader, TheUserKnowsBetter) {
  const std::vector<Return> sweep = makeSweep();
  PointCloudReader last = makeReader({"", "", "last"});  // counted from the first point, stamp at the last
  expectScan(last.read(write(kDialects[1], sweep), nullptr), sweep, kHeader - toNs(sweep.back().time_s), 2e-8);

  PointCloudReader first = makeReader({"", "", "first"});
  expectScan(first.read(write(kDialects[2], sweep, -0.07), nullptr), sweep, kHeader, 6e-7);

  CloudBuilder builder = CloudBuilder().field("clock", PointField::UINT32).field("ring", PointField::UINT16);
  for (const Return& r : sweep) builder.point(r.p, {r.time_s * 1e6, r.ring * 1.0});
  PointCloudReader named = makeReader({"clock", "us", ""});
  expectScan(named.read(builder.build(), nullptr), sweep, kHeader, 1.1e-6);

  PointCloudReader none = makeReader({"none", "", ""});
  ASSERT_TRUE(none.read(write(kDialects[0], sweep), nullptr));
  EXPECT_NE(none.warning().find("azimuth"), std::string::npos) << none.warning();

  std::string problem;
  PointCloudReader absent = makeReader({"no_such_field", "", ""});
  EXPECT_FALSE(absent.read(write(kDialects[0], sweep), &problem));
  EXPECT_NE(problem.find("no_such_field"), std::string::npos);

  PointCloudReader wrong_unit = makeReader({"t", "s", ""});
  EXPECT_FALSE(wrong_unit.read(write(kDialects[1], sweep), &problem));
  EXPECT_NE(problem.find("'t'"), std::string::npos);
}

// Without times: VLP-16 lasers of one firing share an azimuth here, so the azimuth tells the firing exactly.
TEST(PointCloudReader, TimesFromTheAzimuthInBothDirections) {
  for (const double direction : {-1.0, 1.0}) {
    const std::vector<Return> sweep = makeSweep(900, 2.0, direction);
    CloudBuilder builder;
    for (const Return& r : sweep) builder.point(r.p);
    PointCloudReader reader = makeReader();
    expectScan(reader.read(builder.build(), nullptr), sweep, kHeader, 1e-6);
    EXPECT_NE(reader.warning().find(direction < 0.0 ? "azimuth, clockwise" : "counter-clockwise"), std::string::npos);
    EXPECT_NE(reader.warning().find("16 from the elevation"), std::string::npos) << reader.warning();
  }
}

TEST(PointCloudReader, ASweepOfMoreThanOneTurnKeepsCounting) {
  std::vector<Return> sweep = makeSweep(900, 3.0);
  const std::vector<Return> more = makeSweep(900, 3.0);
  for (std::size_t i = 0; i < 20 * 16; ++i) {
    sweep.push_back(more[i]);
    sweep.back().time_s += test::kPeriod_s;
  }
  CloudBuilder builder;
  for (const Return& r : sweep) builder.point(r.p);
  PointCloudReader reader = makeReader();
  expectScan(reader.read(builder.build(), nullptr), sweep, kHeader, 1e-6);
}

TEST(PointCloudReader, AzimuthTimesSurviveAWideGapInTheSweep) {
  std::vector<Return> sweep = makeSweep(900, 0.5);
  sweep.erase(sweep.begin() + 200 * 16, sweep.begin() + 750 * 16);  // 220 degrees of sky
  CloudBuilder builder;
  for (const Return& r : sweep) builder.point(r.p);
  PointCloudReader reader = makeReader();
  expectScan(reader.read(builder.build(), nullptr), sweep, kHeader, 1e-6);
}

TEST(PointCloudReader, AzimuthTimesOfAnOrganizedCloudRingByRing) {
  std::vector<Return> sweep = makeSweep();
  std::stable_sort(sweep.begin(), sweep.end(), [](const Return& a, const Return& b) { return a.ring < b.ring; });
  CloudBuilder builder;
  for (const Return& r : sweep) builder.point(r.p);
  PointCloud2 msg = builder.build();
  msg.height = 16;
  msg.width = 900;
  msg.row_step = 900 * msg.point_step;
  PointCloudReader reader = makeReader();
  expectScan(reader.read(msg, nullptr), sweep, kHeader, 1e-6);
}

TEST(PointCloudReader, TimeStampLastAppliesToAzimuthTimesToo) {
  const std::vector<Return> sweep = makeSweep();
  CloudBuilder builder;
  for (const Return& r : sweep) builder.point(r.p);
  PointCloudReader reader = makeReader({"", "", "last"});
  expectScan(reader.read(builder.build(), nullptr), sweep, kHeader - toNs(sweep.back().time_s), 1e-6);
}

TEST(PointCloudReader, ATimeFieldOfZerosIsNoTime) {
  const std::vector<Return> sweep = makeSweep();
  CloudBuilder builder = CloudBuilder().field("time", PointField::FLOAT32).field("ring", PointField::UINT16);
  for (const Return& r : sweep) builder.point(r.p, {0.0, r.ring * 1.0});
  PointCloudReader reader = makeReader();
  expectScan(reader.read(builder.build(), nullptr), sweep, kHeader, 1e-6);
  EXPECT_NE(reader.warning().find("'time' carries no usable times"), std::string::npos) << reader.warning();
}

TEST(PointCloudReader, ASolidStateCloudWithoutTimesGetsNone) {
  std::mt19937 random(3);
  std::uniform_real_distribution<float> angle(-0.5F, 0.5F);
  CloudBuilder builder;
  for (int i = 0; i < 2000; ++i) builder.point(10.0F * Eigen::Vector3f(1.0F, angle(random), angle(random)));
  PointCloudReader reader = makeReader();
  const std::optional<LidarScan> scan = reader.read(builder.build(), nullptr);
  ASSERT_TRUE(scan);
  for (const LidarPoint& point : scan->points) {
    EXPECT_EQ(point.offset_s, 0.0F);
    EXPECT_EQ(point.ring, -1);
  }
  EXPECT_NE(reader.warning().find("unknown"), std::string::npos) << reader.warning();
}

TEST(PointCloudReader, DropsAndCountsWhatIsNotFiniteOrOutOfRange) {
  std::vector<Return> sweep = makeSweep(100);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const float infinity = std::numeric_limits<float>::infinity();
  CloudBuilder builder = kDialects[0].fields();
  for (const Eigen::Vector3f& bad :
       {Eigen::Vector3f(nan, 1, 1), Eigen::Vector3f(1, infinity, 1), Eigen::Vector3f(0, 0, 0),
        Eigen::Vector3f(0.2F, 0.2F, 0.2F), Eigen::Vector3f(1e30F, 0, 0), Eigen::Vector3f(101, 0, 0)}) {
    builder.point(bad, {0.0, 0.0, 0.0});
  }
  for (const Return& r : sweep) builder.point(r.p, kDialects[0].values(r));
  PointCloudReader reader = makeReader();
  expectScan(reader.read(builder.build(), nullptr), sweep, kHeader, 2e-8);
  EXPECT_EQ(reader.droppedPoints(), 6U);
}

TEST(PointCloudReader, DropsPointsWithAnAbsurdTime) {
  std::vector<Return> sweep = makeSweep(100);
  CloudBuilder builder = kDialects[0].fields();
  for (const Return& r : sweep) builder.point(r.p, kDialects[0].values(r));
  for (const double time : {1e30, std::numeric_limits<double>::quiet_NaN(), -50.0}) {
    builder.point({1.0F, 2.0F, 3.0F}, {0.0, 0.0, time});
  }
  PointCloudReader reader = makeReader();
  expectScan(reader.read(builder.build(), nullptr), sweep, kHeader, 2e-8);
  EXPECT_EQ(reader.droppedPoints(), 3U);
}

TEST(PointCloudReader, ReadsPaddedRowsOfAnOrganizedCloud) {
  const std::vector<Return> sweep = makeSweep(100);
  PointCloud2 msg = write(kDialects[0], sweep);
  const std::uint32_t row = 16 * msg.point_step;
  std::vector<std::uint8_t> padded;
  for (std::size_t begin = 0; begin < msg.data.size(); begin += row) {
    padded.insert(padded.end(), msg.data.begin() + static_cast<std::ptrdiff_t>(begin),
                  msg.data.begin() + static_cast<std::ptrdiff_t>(begin + row));
    padded.insert(padded.end(), 10, 0xFF);
  }
  msg.data = padded;
  msg.height = 100;
  msg.width = 16;
  msg.row_step = row + 10;
  PointCloudReader reader = makeReader();
  expectScan(reader.read(msg, nullptr), sweep, kHeader, 2e-8);
}

TEST(PointCloudReader, ReadsASingleRowWhoseStepWasLeftAtZero) {
  const std::vector<Return> sweep = makeSweep(100);
  PointCloud2 msg = write(kDialects[0], sweep);
  msg.row_step = 0;
  PointCloudReader reader = makeReader();
  expectScan(reader.read(msg, nullptr), sweep, kHeader, 2e-8);
}

TEST(PointCloudReader, RecognisesAgainWhenTheFieldsChange) {
  PointCloudReader reader = makeReader();
  const std::vector<Return> sweep = makeSweep();
  for (const Dialect& dialect : kDialects) {
    expectScan(reader.read(write(dialect, sweep), nullptr), sweep, kHeader, dialect.tolerance_s);
    const std::string field = "field '" + reader.description().substr(20, 3);
    EXPECT_NE(reader.description().find(field), std::string::npos);
  }
}

TEST(PointCloudReader, RecognisesAgainWhenTheSameFieldsMeanSomethingElse) {
  PointCloudReader reader = makeReader();
  const std::vector<Return> sweep = makeSweep();
  ASSERT_TRUE(reader.read(write(kDialects[2], sweep), nullptr));
  std::string problem;
  const PointCloud2 uptime = write(kDialects[2], sweep, 1000.0 - kStamp_s);
  EXPECT_FALSE(reader.read(uptime, &problem));
  EXPECT_NE(problem, "");
  expectScan(reader.read(uptime, &problem), sweep, kHeader, 6e-7);
}

TEST(PointCloudReader, SaysWhyItRefuses) {
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
TEST(PointCloudReader, SurvivesRandomDamage) {
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
