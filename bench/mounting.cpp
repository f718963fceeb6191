// A finished calibration, watched: is a sensor that moves named, with the axis, and how soon; and is nothing said while
// none moves? One table row for each case, over many seeds.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <string>
#include <vector>

#include "monitor/watched_rig.h"
#include "program.h"

namespace {

namespace po = boost::program_options;
using namespace cocalib;

constexpr double kChangeS = 12.0, kAfterS = 25.0;

struct Arguments {
  std::string motion = "full";
  int first_seed = 1, seeds = 3;
  double quiet_s = 600.0;
  bool only_quiet = false;
};

sim::Scenario scenarioOf(const Arguments& a, int seed, double duration_s) {
  sim::Scenario s = sim::parseScenario("motion: " + a.motion, "--motion");
  s.seed = static_cast<std::uint64_t>(seed);
  s.duration_s = duration_s;
  return s;
}

/// Turns the camera by half a degree about, or shifts the lidar by 2 cm along, an axis of the IMU.
/// @return the words that must be said
std::string move(bool camera, int axis, sim::Scenario* s) {
  const std::string name(1, "xyz"[axis]);
  if (!camera) {
    s->lidar.translation[axis] += 0.02;
    return "mm along imu " + name;
  }
  // The mounting as angles again: R = Rz Ry Rx, and the change comes from the left.
  const Eigen::Vector3d turn = 0.5 * M_PI / 180.0 * Eigen::Vector3d::Unit(axis);
  const Eigen::Matrix3d R = expSo3(turn).toRotationMatrix() * sim::rotationFromRpy(s->camera.mounting_rpy);
  s->camera.mounting_rpy = {std::atan2(R(2, 1), R(2, 2)), std::atan2(-R(2, 0), std::hypot(R(2, 1), R(2, 2))),
                            std::atan2(R(1, 0), R(0, 0))};
  return "deg about imu " + name;
}

void runChange(bool camera, int axis, const Arguments& a) {
  int named = 0, other_sensor = 0, other_axis = 0, early = 0;
  double latest_s = 0.0;
  for (int seed = a.first_seed; seed < a.first_seed + a.seeds; ++seed) {
    test::WatchedRig rig(scenarioOf(a, seed, kChangeS + kAfterS));
    const std::string words = move(camera, axis, &rig.after());
    double first_s = -1.0;
    for (const test::FoundChange& found : rig.run(kChangeS)) {
      early += found.time_s < kChangeS;
      const bool sensor = found.change.sensor == (camera ? "camera" : "lidar");
      other_sensor += !sensor;
      other_axis += sensor && found.change.words.find(words) == std::string::npos;
      if (sensor && first_s < 0.0) first_s = found.time_s - kChangeS;
    }
    named += first_s >= 0.0;
    latest_s = std::max(latest_s, first_s);
  }
  std::printf("| %s %s %c | %d/%d | %.1f | %d | %d | %d |\n",
              camera ? "camera turned 0.5 deg about" : "lidar shifted 20 mm along", "imu", "xyz"[axis], named, a.seeds,
              latest_s, other_sensor, other_axis, early);
  std::fflush(stdout);
}

void runQuiet(const Arguments& a) {
  for (int seed = a.first_seed; seed < a.first_seed + a.seeds; ++seed) {
    test::WatchedRig rig(scenarioOf(a, seed, a.quiet_s));
    const std::vector<test::FoundChange> found = rig.run(a.quiet_s + 1.0);
    std::printf("no change for %.0f s, seed %d: %d looks, %zu false reports\n", a.quiet_s, seed, rig.pieces(),
                found.size());
    for (const test::FoundChange& f : found) std::printf("  at %.1f s: %s\n", f.time_s, f.change.words.c_str());
    std::fflush(stdout);
  }
}

po::options_description describe(Arguments* a) {
  po::options_description options(
      "usage: bench_mounting [options]\n"
      "Watches a calibration while a sensor moves, and while none does, on simulated measurements");
  auto add = options.add_options();
  add("help,h", "this text");
  add("motion", po::value(&a->motion)->default_value(a->motion), "of the rig, as in a scenario file");
  add("first-seed", po::value(&a->first_seed)->default_value(a->first_seed), "");
  add("seeds", po::value(&a->seeds)->default_value(a->seeds), "how many");
  add("quiet", po::value(&a->quiet_s)->default_value(a->quiet_s), "seconds without a change; 0: leave that out");
  add("only-quiet", po::bool_switch(&a->only_quiet), "leave the changes out");
  return options;
}

void runChanges(const Arguments& a) {
  std::printf(
      "named: seeds in which the sensor is named; latest: seconds from the change to the first report; reports that "
      "name\n"
      "the other sensor, or another axis of the right one; reports before the change\n\n"
      "| change | named | latest [s] | other sensor | other axis | early |\n|---|---|---|---|---|---|\n");
  for (const bool camera : {true, false}) {
    for (int axis = 0; axis < 3; ++axis) runChange(camera, axis, a);
  }
}

void run(const Arguments& a) {
  if (!a.only_quiet) runChanges(a);
  if (a.quiet_s > 0.0) runQuiet(a);
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  return bench::runProgram("bench_mounting", argc, argv, describe(&arguments), [&] { run(arguments); });
}
