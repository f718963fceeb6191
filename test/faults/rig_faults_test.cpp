// Faults that strike a rig with IMU, camera and lidar, one by one (docs/reliability.md): see imu_faults_test.cpp. What
// only one stream shows is in the tests of that stream.

#include "fault_table.h"

namespace cocalib::test {
namespace {

using Event = Recording::Event;
using Kind = Recording::Kind;

/// Nothing of one kind until `to_s`.
std::function<void(Recording*)> lose(Kind kind, double to_s) {
  return [kind, to_s](Recording* r) { r->change(kind, kFrom, to_s, [](Event*, int) { return false; }); };
}

void blackout(Recording* r) {
  r->change(Kind::kPicture, kFrom, kTo, [](Event* e, int) {
    e->picture.seen.tracks.clear();
    e->picture.seen.board.reset();
    return true;
  });
}

/// The host's clock, by which all drivers stamp.
std::function<void(Recording*)> setClock(double by_s) {
  return [by_s](Recording* r) {
    const TimeNs by = toNs(by_s);
    const double end_s = r->scenario.duration_s + 1.0;
    r->change(Kind::kImu, kFrom, end_s, [by](Event* e, int) {
      e->imu.header.stamp = toRosTime(toTimeNs(e->imu.header.stamp) + by);
      return true;
    });
    r->change(Kind::kCloud, kFrom, end_s, [by](Event* e, int) {
      e->cloud.header.stamp = toRosTime(toTimeNs(e->cloud.header.stamp) + by);
      return true;
    });
    r->change(Kind::kPicture, kFrom, end_s, [by](Event* e, int) {
      e->picture.seen.stamp += by;
      return true;
    });
  };
}

std::vector<Row> rows() {
  return {
      {"no imu for 0.5 s", false, "no inertial data for 0.5 s", kNewStart_s, Fate::kHonest, lose(Kind::kImu, 8.5), 8.5},
      {"camera blackout", true, "too few features", kAtOnce_s, Fate::kAsGood, blackout},
      {"lidar silent for 5 s", false, "", kNewStart_s, Fate::kHonest, lose(Kind::kCloud, 13.0), 13.0},
      {"clock set back by a minute", false, "restarts", kNewStart_s, Fate::kHonest, setClock(-60.0), kFrom, 0.10,
       -60.0},
      {"clock set ahead by a minute", false, "its clock was set ahead by 60 s", kNewStart_s, Fate::kHonest,
       setClock(60.0), kFrom, 0.10, 60.0},
  };
}

TEST(RigFaults, OneByOne) { expectSurvived(rows(), Faultless(Recording::ofRig())); }

}  // namespace
}  // namespace cocalib::test
