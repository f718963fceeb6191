// Monte Carlo of the calibration's accuracy: errors over many seeds against the estimators' own covariance.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <string>
#include <vector>

#include "live.h"
#include "program.h"
#include "statistics.h"
#include "trial.h"

namespace {

namespace po = boost::program_options;
using namespace cocalib;

struct Arguments {
  std::string scenario, sensors = "cl", csv;
  std::vector<std::string> results;
  int first_seed = 1, seeds = 10;
  double duration_s = 60.0;
  bool no_board = false, no_tracks = false;
};

po::options_description describe(Arguments* a) {
  po::options_description options(
      "usage: bench_accuracy [options]\n"
      "Runs the calibrators on simulated measurements (no pictures are rendered), or reads results of calibrate_bag");
  options.add_options()("help,h", "this text")("scenario", po::value(&a->scenario),
                                               "scenario file; default: the paper's rig")(
      "sensors", po::value(&a->sensors)->default_value(a->sensors), "c: camera, l: lidar, cl: both")(
      "first-seed", po::value(&a->first_seed)->default_value(a->first_seed), "")(
      "seeds", po::value(&a->seeds)->default_value(a->seeds), "how many")(
      "duration", po::value(&a->duration_s)->default_value(a->duration_s), "seconds of data")(
      "no-board", po::bool_switch(&a->no_board), "without the chessboard")("no-tracks", po::bool_switch(&a->no_tracks),
                                                                           "without natural features")(
      "csv", po::value(&a->csv), "write every trial's errors and sigmas there")(
      "results", po::value(&a->results)->multitoken(),
      "RESULT_DIR TRUTH.yaml ...: of calibrate_bag, instead of trials");
  return options;
}

class Report {
 public:
  explicit Report(const Arguments& a)
      : camera_(a.sensors.find('c') != std::string::npos),
        lidar_(a.sensors.find('l') != std::string::npos),
        joint_(camera_ && lidar_ ? "joint"
               : camera_         ? "camera, long window"
                                 : "lidar, long window",
               camera_, lidar_),
        two_step_("calibrators alone", camera_, lidar_) {
    if (!a.csv.empty()) csv_.open(a.csv);
  }

  void add(const std::string& name, const bench::Trial& trial) {
    const CalibrationEstimate& e = trial.joint;
    if (e.status == Status::kInsufficientData) {
      std::printf("%s: %s (%s)\n", name.c_str(), toString(e.status), e.message.c_str());
      return;
    }
    joint_.add(e, trial.truth);
    const bool alone = (!camera_ || trial.visual.camera.valid) && (!lidar_ || trial.lidar.lidar.valid);
    if (alone) two_step_.add(bench::twoStep(trial.visual, trial.lidar), trial.truth);
    const Vector14d error = bench::errorOf(e.calibration, trial.truth);
    std::printf(
        "%s: %s, camera %.4f mrad %.4f mm, lidar %.4f mrad %.4f mm; cpu s: camera %.1f lidar %.1f "
        "joint %.1f last round %.1f\n",
        name.c_str(), toString(e.status), 1e3 * error.segment<3>(3).norm(), 1e3 * error.head<3>().norm(),
        1e3 * error.segment<3>(9).norm(), 1e3 * error.segment<3>(6).norm(), trial.cpu.camera_s, trial.cpu.lidar_s,
        trial.cpu.joint_s, trial.cpu.last_round_s);
    std::printf("  NEES %.1f", joint_.newestNees());
    if (alone) std::printf(", calibrators alone %.1f", two_step_.newestNees());
    std::printf("%s%s\n", e.status != Status::kConverged ? "; " : "",
                e.status != Status::kConverged ? e.message.c_str() : "");
    std::fflush(stdout);
    if (!csv_.is_open()) return;
    csv_ << name;
    for (int i = 0; i < 14; ++i) csv_ << ',' << error[i] << ',' << std::sqrt(std::max(0.0, e.covariance(i, i)));
    csv_ << std::endl;  // a long run can be watched, and cut short
  }

  void print() const {
    std::printf("%s", joint_.table().c_str());
    if (two_step_.count() > 0) std::printf("%s", two_step_.table().c_str());
  }

 private:
  bool camera_, lidar_;
  bench::Statistics joint_, two_step_;
  std::ofstream csv_;
};

void run(const Arguments& a) {
  Report report(a);
  if (!a.results.empty()) {
    for (std::size_t i = 0; i + 1 < a.results.size(); i += 2) {
      const bench::Trial trial = bench::loadTrial(a.results[i], a.results[i + 1]);
      report.add(a.results[i], trial);
      std::printf("  on the way: %s\n", bench::liveLine(a.results[i], trial.truth).c_str());
    }
  } else {
    bench::TrialOptions options;
    options.camera = a.sensors.find('c') != std::string::npos;
    options.lidar = a.sensors.find('l') != std::string::npos;
    options.board = !a.no_board;
    options.tracks = !a.no_tracks;
    for (int seed = a.first_seed; seed < a.first_seed + a.seeds; ++seed) {
      sim::Scenario scenario = a.scenario.empty() ? sim::Scenario() : sim::loadScenario(a.scenario);
      scenario.seed = static_cast<std::uint64_t>(seed);
      scenario.duration_s = a.duration_s;
      report.add("seed " + std::to_string(seed), bench::runTrial(scenario, options));
    }
  }
  report.print();
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  return bench::runProgram("bench_accuracy", argc, argv, describe(&arguments), [&] { run(arguments); });
}
