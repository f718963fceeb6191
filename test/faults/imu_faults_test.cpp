// Faults of the inertial stream, one by one, with a lidar and with a camera (docs/reliability.md): the process lives,
// the result is what the table says it is worth, nothing published is NaN, and one line names the cause.

#include <limits>

#include "fault_table.h"

namespace cocalib::test {
namespace {

using Event = Recording::Event;
constexpr auto kImu = Recording::Kind::kImu;

/// Strikes every nth sample of the fault's time.
std::function<void(Recording*)> each(int nth, const std::function<void(sensor_msgs::Imu*)>& strike) {
  return [nth, strike](Recording* r) {
    r->change(kImu, kFrom, kTo, [&](Event* e, int number) {
      if (number % nth == 0) strike(&e->imu);
      return true;
    });
  };
}

/// Every nth stamp is off by so many seconds.
std::function<void(Recording*)> stampsOff(int nth, double by_s) {
  return each(
      nth, [by_s](sensor_msgs::Imu* imu) { imu->header.stamp = toRosTime(toTimeNs(imu->header.stamp) + toNs(by_s)); });
}

std::function<void(Recording*)> gap(double seconds) {
  return [seconds](Recording* r) { r->change(kImu, kFrom, kFrom + seconds, [](Event*, int) { return false; }); };
}

/// The driver's range is narrower than the motion, from the begin to the end.
void saturate(Recording* r) {
  static constexpr double kLimit = 1.0;  // [rad/s]
  r->change(kImu, -1.0, r->scenario.duration_s + 1.0, [](Event* e, int) {
    geometry_msgs::Vector3& rate = e->imu.angular_velocity;
    for (double* w : {&rate.x, &rate.y, &rate.z}) *w = std::clamp(*w, -kLimit, kLimit);
    return true;
  });
}

/// The same numbers under new stamps.
void stick(Recording* r) {
  sensor_msgs::Imu first;
  r->change(kImu, kFrom, kTo, [&](Event* e, int number) {
    if (number == 0) first = e->imu;
    e->imu.angular_velocity = first.angular_velocity;
    e->imu.linear_acceleration = first.linear_acceleration;
    return true;
  });
}

void loseEveryTenth(Recording* r) {
  r->change(kImu, kFrom, kTo, [](Event*, int number) { return number % 10 != 0; });
}

void breakNumbers(sensor_msgs::Imu* imu) {
  imu->angular_velocity.x = std::numeric_limits<double>::quiet_NaN();
  imu->linear_acceleration.z = std::numeric_limits<double>::infinity();
}

std::vector<Row> rows() {
  const std::string order = "imu samples out of order";
  return {
      {"every tenth lost", false, "messages are missing", kAtOnce_s, Fate::kAsGood, loseEveryTenth},
      {"gap of 0.05 s", false, "", kAtOnce_s, Fate::kAsGood, gap(0.05), kFrom + 0.05},
      {"gap of 0.5 s", false, "no inertial data for 0.5 s", kNewStart_s, Fate::kHonest, gap(0.5), kFrom + 0.5},
      {"gap of 5 s", true, "no inertial data for 5.0 s", kNewStart_s, Fate::kHonest, gap(5.0), kFrom + 5.0},
      {"repeated", false, order, kAtOnce_s, Fate::kAsGood, [](Recording* r) { r->repeat(kImu, 3); }},
      {"received late", false, order, kAtOnce_s, Fate::kAsGood, [](Recording* r) { r->delay(kImu, 10, 0.02); }},
      {"stamps back by 0.4 s", false, order, kAtOnce_s, Fate::kAsGood, stampsOff(20, -0.4)},
      {"stamps ahead by an hour", false, order, kAtOnce_s, Fate::kAsGood, stampsOff(50, 3600.0)},
      {"stamps back by an hour", false, order, kAtOnce_s, Fate::kAsGood, stampsOff(50, -3600.0)},
      {"no stamp", false, "no stamp", kAtOnce_s, Fate::kAsGood,
       each(10, [](sensor_msgs::Imu* imu) { imu->header.stamp = ros::Time(); })},
      {"NaN and infinity", false, "not finite", kAtOnce_s, Fate::kAsGood, each(10, breakNumbers)},
      {"absurd numbers", false, "imu samples refused", kAtOnce_s, Fate::kAsGood,
       each(10, [](sensor_msgs::Imu* imu) { imu->linear_acceleration.y = 1e200; })},
      {"saturated", false, "has reached the end of its range", kNever_s, Fate::kHonest, saturate},
      {"stuck", false, "is stuck", kNewStart_s, Fate::kHonest, stick},
  };
}

TEST(ImuFaults, WithALidar) { expectSurvived(rows(), Faultless(Recording::ofLidar())); }
TEST(ImuFaults, WithACamera) { expectSurvived(rows(), Faultless(Recording::ofCamera())); }

}  // namespace
}  // namespace cocalib::test
