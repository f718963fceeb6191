// Motion, or a place, that leaves a part of the calibration open: is it flagged, is it never called converged, does the
// truth lie within the stated sigma, and how well is the rest found? One table row for each case and sensor, over many
// seeds.
#include <algorithm>
#include <cmath>
#include <cstdio>
#include <set>
#include <string>
#include <vector>

#include "program.h"
#include "trial.h"

namespace {

namespace po = boost::program_options;
using namespace cocalib;

/// Axes 0-2: translation along imu x, y, z; 3-5: rotation about them.
using Axes = std::set<int>;
const Axes kNothing, kUp = {2}, kLever = {0, 1, 2}, kAll = {0, 1, 2, 3, 4, 5};

struct Case {
  const char* name;
  sim::Motion motion;
  bench::TrialOptions options;  ///< camera, lidar, board, tracks
  Axes camera, lidar;           ///< what the motion leaves open, at least
  sim::Place place = sim::Place::kRoom;
};

const std::vector<Case>& cases() {
  using sim::Motion;
  using sim::Place;
  const bench::TrialOptions lidar{false, true, false, false}, board{true, false, true, true},
      tracks{true, false, false, true}, joint{true, true, true, true};
  static const std::vector<Case> all = {
      {"planar lidar", Motion::kPlanar, lidar, kNothing, kUp},
      {"planar board", Motion::kPlanar, board, kUp, kNothing},
      {"planar tracks", Motion::kPlanar, tracks, kUp, kNothing},
      {"planar joint", Motion::kPlanar, joint, kUp, kUp},
      {"upright lidar", Motion::kUpright, lidar, kNothing, kUp},
      {"upright board", Motion::kUpright, board, kUp, kNothing},
      {"upright tracks", Motion::kUpright, tracks, kUp, kNothing},
      {"translation lidar", Motion::kTranslationOnly, lidar, kNothing, kLever},
      {"translation board", Motion::kTranslationOnly, board, kLever, kNothing},
      {"translation tracks", Motion::kTranslationOnly, tracks, kLever, kNothing},
      {"translation joint", Motion::kTranslationOnly, joint, kLever, kLever},
      {"rotation lidar", Motion::kRotationOnly, lidar, kNothing, kNothing},
      {"rotation board", Motion::kRotationOnly, board, kNothing, kNothing},
      {"rotation tracks", Motion::kRotationOnly, tracks, {0}, kNothing},  // the scale: along the lever arm, imu x
      {"static lidar", Motion::kStatic, lidar, kNothing, kAll},
      {"static joint", Motion::kStatic, joint, kAll, kAll},
      // What a corridor or a wall hides of the way, the inertial data show: only the motion leaves anything open.
      {"corridor lidar", Motion::kFull, lidar, kNothing, kNothing, Place::kCorridor},
      {"corridor planar lidar", Motion::kPlanar, lidar, kNothing, kUp, Place::kCorridor},
      {"corridor translation lidar", Motion::kTranslationOnly, lidar, kNothing, kLever, Place::kCorridor},
      {"wall lidar", Motion::kFull, lidar, kNothing, kNothing, Place::kWall},
      {"wall planar lidar", Motion::kPlanar, lidar, kNothing, kUp, Place::kWall},
  };
  return all;
}

struct Arguments {
  std::string only;
  int first_seed = 1, seeds = 10;
  double duration_s = 60.0;
};

/// One sensor of one case, over the seeds.
class Row {
 public:
  Row(std::string name, Axes open) : name_(std::move(name)), open_(std::move(open)) {}

  void add(const CalibrationEstimate& estimate, const SensorVerdict& verdict, const Vector6d& error) {
    ++trials_;
    converged_ += estimate.status == Status::kConverged;
    if (!verdict.valid) return;
    ++valid_;
    const Axes flagged = flaggedBy(verdict);
    complete_ += std::includes(flagged.begin(), flagged.end(), open_.begin(), open_.end());
    for (int i = 0; i < 6; ++i) {
      const double ratio = std::abs(error[i]) / std::max(verdict.sigma[i], 1e-12);
      if (flagged.count(i) > 0) {
        worst_open_ = std::max(worst_open_, ratio);
        extra_ += open_.count(i) == 0;
      } else {
        worst_seen_ = std::max(worst_seen_, ratio);
        (i < 3 ? shifts_ : turns_).push_back(error[i]);
      }
    }
  }

  void print() const {
    std::printf("| %-26s | %2d/%-2d | %2d/%-2d | %3d | %2d | %5.2f | %5.2f | %8.3f | %8.3f |\n", name_.c_str(), valid_,
                trials_, complete_, trials_, extra_, converged_, worst_open_, worst_seen_, 1e3 * rms(shifts_),
                1e3 * rms(turns_));
    std::fflush(stdout);
  }

 private:
  static Axes flaggedBy(const SensorVerdict& verdict) {
    Axes axes;
    for (const std::string& text : verdict.unobservable) {
      const std::size_t colon = text.find(':');
      axes.insert((text.rfind("rotation", 0) == 0 ? 3 : 0) + text.at(colon - 1) - 'x');
    }
    return axes;
  }
  static double rms(const std::vector<double>& errors) {
    double sum = 0.0;
    for (const double error : errors) sum += error * error;
    return errors.empty() ? std::nan("") : std::sqrt(sum / static_cast<double>(errors.size()));
  }

  std::string name_;
  Axes open_;
  int trials_ = 0, valid_ = 0, complete_ = 0, extra_ = 0, converged_ = 0;
  double worst_open_ = 0.0, worst_seen_ = 0.0;
  std::vector<double> shifts_, turns_;
};

void runCase(const Case& c, const Arguments& a) {
  std::vector<Row> rows;
  const bool both = c.options.camera && c.options.lidar;
  if (c.options.camera)
    rows.insert(rows.end(), {{std::string(c.name) + ", camera alone", c.camera}, {"camera", c.camera}});
  if (c.options.lidar) rows.insert(rows.end(), {{std::string(c.name) + ", lidar alone", c.lidar}, {"lidar", c.lidar}});
  if (both) rows.emplace_back("lidar to camera", c.motion == sim::Motion::kStatic ? kAll : kNothing);
  for (int seed = a.first_seed; seed < a.first_seed + a.seeds; ++seed) {
    sim::Scenario scenario;
    scenario.motion = c.motion;
    scenario.place = c.place;
    if (c.place != sim::Place::kRoom) scenario.board.present = false;
    scenario.seed = static_cast<std::uint64_t>(seed);
    scenario.duration_s = a.duration_s;
    scenario.camera.time_offset_s = 0.02;
    scenario.lidar.time_offset_s = -0.015;
    const bench::Trial trial = bench::runTrial(scenario, c.options);
    const auto cameraError = [&](const CalibrationEstimate& e) {
      return e.calibration.T_imu_camera.minus(trial.truth.T_imu_camera);
    };
    const auto lidarError = [&](const CalibrationEstimate& e) {
      return e.calibration.T_imu_lidar.minus(trial.truth.T_imu_lidar);
    };
    auto row = rows.begin();
    if (c.options.camera) (row++)->add(trial.visual, trial.visual.camera, cameraError(trial.visual));
    if (c.options.camera) (row++)->add(trial.joint, trial.joint.camera, cameraError(trial.joint));
    if (c.options.lidar) (row++)->add(trial.lidar, trial.lidar.lidar, lidarError(trial.lidar));
    if (c.options.lidar) (row++)->add(trial.joint, trial.joint.lidar, lidarError(trial.joint));
    if (!both) continue;
    const Pose estimate = trial.joint.calibration.T_lidar_camera(), truth = trial.truth.T_lidar_camera();
    row->add(trial.joint, trial.joint.lidar_camera, estimate.minus(truth));
  }
  for (const Row& row : rows) row.print();
}

po::options_description describe(Arguments* a) {
  po::options_description options(
      "usage: bench_degenerate [options]\n"
      "Runs the calibrators without a guess on simulated measurements of motion that leaves directions open");
  auto add = options.add_options();
  add("help,h", "this text");
  add("case", po::value(&a->only), "only the cases whose name begins so");
  add("first-seed", po::value(&a->first_seed)->default_value(a->first_seed), "");
  add("seeds", po::value(&a->seeds)->default_value(a->seeds), "how many");
  add("duration", po::value(&a->duration_s)->default_value(a->duration_s), "seconds of data");
  return options;
}

void run(const Arguments& a) {
  std::printf(
      "valid: seeds with an estimate; open: with every open axis flagged; more: flags on other axes; conv: called\n"
      "converged; e/s: largest error over sigma, of flagged and of other axes; rms of the others, mm and mrad\n\n"
      "| case                       | valid | open  | more | conv | e/s flagged | e/s others | mm | mrad |\n"
      "|---|---|---|---|---|---|---|---|---|\n");
  for (const Case& c : cases()) {
    if (std::string(c.name).rfind(a.only, 0) == 0) runCase(c, a);
  }
}

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  return bench::runProgram("bench_degenerate", argc, argv, describe(&arguments), [&] { run(arguments); });
}
