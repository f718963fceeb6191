#include "cocalib/ros/point_cloud_reader.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "ros/point_cloud_dialects.h"

namespace cocalib {
namespace {

using namespace test;

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

}  // namespace
}  // namespace cocalib
