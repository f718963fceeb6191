// Faults of the lidar's clouds, one by one (docs/reliability.md): see imu_faults_test.cpp.

#include <cmath>
#include <cstring>
#include <limits>

#include "fault_table.h"

namespace cocalib::test {
namespace {

using Event = Recording::Event;
using Cloud = sensor_msgs::PointCloud2;
constexpr auto kCloud = Recording::Kind::kCloud;
constexpr float kNaN = std::numeric_limits<float>::quiet_NaN();
constexpr float kInfinity = std::numeric_limits<float>::infinity();

/// Strikes every nth cloud of the fault's time.
std::function<void(Recording*)> each(int nth, const std::function<void(Cloud*)>& strike) {
  return [nth, strike](Recording* r) {
    r->change(kCloud, kFrom, kTo, [&](Event* e, int number) {
      if (number % nth == 0) strike(&e->cloud);
      return true;
    });
  };
}

std::function<void(Recording*)> stampsOff(int nth, double by_s) {
  return each(nth, [by_s](Cloud* c) { c->header.stamp = toRosTime(toTimeNs(c->header.stamp) + toNs(by_s)); });
}

/// @param part  of three
std::function<void(Recording*)> lose(double to_s, int part) {
  return [to_s, part](Recording* r) {
    r->change(kCloud, kFrom, to_s, [part](Event*, int number) { return number % 3 >= part; });
  };
}

/// Writes a number over a field of every nth point.
void overwrite(Cloud* cloud, int nth, std::size_t offset, float value) {
  for (std::size_t i = 0; i < std::size_t{cloud->width} * cloud->height; i += static_cast<std::size_t>(nth)) {
    std::memcpy(&cloud->data[i * cloud->point_step + offset], &value, sizeof(value));
  }
}

void breakNumbers(Cloud* cloud) {
  overwrite(cloud, 3, 0, kNaN);
  overwrite(cloud, 7, 4, kInfinity);
}

void empty(Cloud* cloud) {
  cloud->width = cloud->row_step = 0;
  cloud->data.clear();
}

void keepOnePoint(Cloud* cloud) {
  cloud->width = cloud->height = 1;
  cloud->row_step = cloud->point_step;
  cloud->data.resize(cloud->point_step);
}

/// The same points again and again.
void growToAMillion(Cloud* cloud) {
  const std::vector<std::uint8_t> once = cloud->data;
  const std::size_t copies = 1'000'000 / (once.size() / cloud->point_step) + 1;
  for (std::size_t i = 1; i < copies; ++i) cloud->data.insert(cloud->data.end(), once.begin(), once.end());
  cloud->height = 1;
  cloud->width = static_cast<std::uint32_t>(cloud->data.size() / cloud->point_step);
  cloud->row_step = cloud->width * cloud->point_step;
}

/// Something stands in a tenth of the view, a metre and a half off, and comes and goes by itself.
void moveAnObject(Recording* r) {
  r->change(kCloud, kFrom, kTo, [](Event* e, int) {
    Cloud& cloud = e->cloud;
    const auto distance = static_cast<float>(1.5 + 0.5 * std::sin(3.0 * e->received_s));
    for (std::size_t i = 0; i < std::size_t{cloud.width} * cloud.height; ++i) {
      float p[3];
      std::memcpy(p, &cloud.data[i * cloud.point_step], sizeof(p));
      if (p[0] <= 0.0F || std::abs(p[1]) > 0.32F * p[0]) continue;
      const float scale = distance / p[0];
      for (float& x : p) x *= scale;
      std::memcpy(&cloud.data[i * cloud.point_step], p, sizeof(p));
    }
    return true;
  });
}

/// The lidar's clock runs fast. @param rate  by so much
std::function<void(Recording*)> drift(double rate) {
  return [rate](Recording* r) {
    r->change(kCloud, 0.0, r->scenario.duration_s, [&](Event* e, int) {
      const TimeNs since = toTimeNs(e->cloud.header.stamp) - r->scenario.epoch;
      e->cloud.header.stamp = toRosTime(r->scenario.epoch + since + toNs(rate * toSeconds(since)));
      return true;
    });
  };
}

std::vector<Row> rows() {
  const std::string order = "scans out of order", claims = "cloud claims";
  return {
      {"every third lost", false, "", kAtOnce_s, Fate::kAsGood, lose(kTo, 1)},
      {"repeated", false, order, kAtOnce_s, Fate::kAsGood, [](Recording* r) { r->repeat(kCloud, 2); }},
      {"received late", false, order, kAtOnce_s, Fate::kAsGood, [](Recording* r) { r->delay(kCloud, 8, 0.15); }},
      {"stamps back by 0.5 s", false, order, kAtOnce_s, Fate::kAsGood, stampsOff(5, -0.5)},
      {"stamps ahead by an hour", false, "seconds away", kAtOnce_s, Fate::kAsGood, stampsOff(5, 3600.0)},
      {"stamps back by an hour", false, "seconds away", kAtOnce_s, Fate::kAsGood, stampsOff(5, -3600.0)},
      {"stamps ahead by 3 s", false, order, kAtOnce_s, Fate::kAsGood, stampsOff(7, 3.0)},
      {"clock 20 ppm fast", false, "differ in lidar clock offset", kAtOnce_s, Fate::kHonest, drift(2e-5)},
      {"NaN and infinity", false, "points dropped", kAtOnce_s, Fate::kAsGood, each(1, breakNumbers)},
      {"absurd points", false, "points dropped", kAtOnce_s, Fate::kAsGood,
       each(1, [](Cloud* c) { overwrite(c, 5, 8, 1e30F); })},
      {"empty", false, "empty", kAtOnce_s, Fate::kAsGood, each(2, empty)},
      {"one point", false, "", kAtOnce_s, Fate::kAsGood, each(2, keepOnePoint)},
      {"a million points", false, "", kAtOnce_s, Fate::kAsGood, each(10, growToAMillion)},
      {"lying width", true, claims, kAtOnce_s, Fate::kAsGood, each(2, [](Cloud* c) { c->width *= 1000; })},
      {"lying height", false, claims, kAtOnce_s, Fate::kAsGood, each(2, [](Cloud* c) { c->height = 4'000'000'000U; })},
      {"lying step", false, claims, kAtOnce_s, Fate::kAsGood, each(2, [](Cloud* c) { c->point_step = 0; })},
      {"lying offset", false, "ends at byte", kAtOnce_s, Fate::kAsGood,
       each(2, [](Cloud* c) { c->fields[0].offset = 100'000; })},
      {"other type of a field", false, "float32 is needed", kAtOnce_s, Fate::kAsGood,
       each(2, [](Cloud* c) { c->fields[1].datatype = sensor_msgs::PointField::FLOAT64; })},
      {"fields in another order", false, "", kAtOnce_s, Fate::kAsGood,
       each(2, [](Cloud* c) { std::reverse(c->fields.begin(), c->fields.end()); })},
      {"something moves by itself", false, "", kAtOnce_s, Fate::kHonest, moveAnObject},
      {"gone for 6 s", false, "no sweeps for longer than the window", kNewStart_s, Fate::kHonest, lose(14.0, 3), 14.0},
  };
}

TEST(LidarFaults, OneByOne) { expectSurvived(rows(), Faultless(Recording::ofLidar())); }

}  // namespace
}  // namespace cocalib::test
