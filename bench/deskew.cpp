// The lidar-inertial calibrator over time on simulated sweeps: error of the calibration, quality of the deskew, planes,
// processor time and memory, one line for each second of data.
#include <sys/resource.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <cstdio>
#include <fstream>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"
#include "program.h"

namespace {

namespace po = boost::program_options;
using namespace cocalib;

struct Arguments {
  std::string scenario, csv;
  int seed = 1, max_points = LidarInertialParams().max_points;
  double duration_s = 60.0;
  bool fuser = false;
};

po::options_description describe(Arguments* a) {
  po::options_description options("usage: bench_deskew [options]");
  options.add_options()("help,h", "this text")("scenario", po::value(&a->scenario), "file; default: the paper's rig")(
      "seed", po::value(&a->seed)->default_value(a->seed), "")(
      "duration", po::value(&a->duration_s)->default_value(a->duration_s), "seconds of data")(
      "max-points", po::value(&a->max_points)->default_value(a->max_points), "kept of a sweep")(
      "fuser", po::bool_switch(&a->fuser), "with the fuser behind it, and its feedback")("csv", po::value(&a->csv),
                                                                                         "write the lines there too");
  return options;
}

double residentMegabytes() {
  std::ifstream file("/proc/self/statm");
  double total = 0.0, resident = 0.0;
  file >> total >> resident;
  return resident * 4096e-6;
}

/// Sum of squares of distances, and their number.
struct Distances {
  double square = 0.0;
  std::size_t count = 0;

  void add(double distance) {
    square += distance * distance;
    ++count;
  }
  double rms() const { return count > 0 ? std::sqrt(square / static_cast<double>(count)) : 0.0; }
};

/// Of the points of a sweep to the planes that they truly lie on, once all are brought to one instant.
struct DeskewQuality {
  Distances ours;       ///< with the calibrator's deskew
  Distances truth;      ///< each point from the true pose at its time: what is left is the noise of the ranges
  Distances untouched;  ///< all points as if taken at the end of the sweep
};

class Run {
 public:
  explicit Run(const Arguments& a)
      : scenario_(a.scenario.empty() ? sim::Scenario() : sim::loadScenario(a.scenario)), with_fuser_(a.fuser) {
    scenario_.seed = static_cast<std::uint64_t>(a.seed);
    scenario_.duration_s = a.duration_s;
    if (!a.csv.empty()) csv_.open(a.csv);
    scene_.emplace(scenario_);
    trajectory_.emplace(scenario_);
    LidarInertialParams params;
    params.range_noise_m = scenario_.lidar.range_noise_m;
    params.max_points = a.max_points;
    max_points_ = a.max_points;
    const ImuNoise noise{scenario_.imu.gyro_noise_density, 1e-6, scenario_.imu.accel_noise_density, 1e-5};
    calibrator_.emplace(params, noise, std::nullopt);
    FuserParams fuser_params;
    fuser_params.range_noise_m = params.range_noise_m;
    FuserInputs inputs;
    inputs.lidar = true;
    fuser_.emplace(fuser_params, noise, inputs);
  }

  void run() {
    const std::vector<ImuSample> imu = sim::simulateImu(scenario_, *trajectory_);
    std::size_t next_imu = 0;
    printHeader();
    const int per_second = static_cast<int>(std::lround(scenario_.lidar.rate_hz));
    for (int k = 0; k < sim::scanCount(scenario_); ++k) {
      const sim::SimulatedScan sweep = sim::simulateScan(scenario_, *scene_, *trajectory_, k);
      const TimeNs arrives = trajectory_->stampOf((k + 1) / scenario_.lidar.rate_hz + 0.003);
      const double begin = bench::processCpu();
      for (; next_imu < imu.size() && imu[next_imu].stamp <= arrives; ++next_imu) {
        calibrator_->addImu(imu[next_imu]);
        if (with_fuser_) fuser_->addImu(imu[next_imu]);
      }
      take(calibrator_->addScan(sweep.scan));
      cpu_s_ += bench::processCpu() - begin;
      sweeps_.push_back(sweep);
      if (sweeps_.size() > 12) sweeps_.erase(sweeps_.begin());
      measureDeskew();
      if ((k + 1) % per_second == 0) printLine((k + 1) / scenario_.lidar.rate_hz);
    }
    const double begin = bench::processCpu();
    take(calibrator_->flush());
    if (with_fuser_) fuser_->finish();
    cpu_s_ += bench::processCpu() - begin;
    printLine(scenario_.duration_s);
    const CalibratorDiagnostics diagnostics = with_fuser_ ? fuser_->diagnostics() : calibrator_->diagnostics();
    for (const auto& [what, number] : diagnostics.counts) {
      std::fprintf(stderr, "%s: %llu\n", what.c_str(), static_cast<unsigned long long>(number));
    }
  }

 private:
  void take(std::vector<LidarKeyframe> keyframes) {
    if (!with_fuser_) return;
    for (LidarKeyframe& keyframe : keyframes) fuser_->addLidar(std::move(keyframe));
    fuser_->setLidarEstimate(calibrator_->estimate());
    if (!fuser_->wantsSolve() || !fuser_->solve()) return;
    calibrator_->setJointCalibration(fuser_->estimate().calibration);
  }

  /// The cloud as a user gets it, seen from the lidar at its instant, laid into the true world there.
  void measureDeskew() {
    const std::optional<DeskewedCloud> cloud = calibrator_->deskewedCloud();
    if (!cloud || cloud->sweep == last_cloud_) return;
    last_cloud_ = cloud->sweep;
    const Calibration& calibration = cloud->calibration;
    for (const sim::SimulatedScan& sweep : sweeps_) {
      std::size_t stride = sweep.scan.points.size() / static_cast<std::size_t>(max_points_) + 1;
      if (stride % 2 == 0) ++stride;  // as the calibrator thins them
      if (sweep.scan.stamp != cloud->sweep) continue;
      const Pose T_W_L = trajectory_->T_W_I(trajectory_->timeOf(cloud->stamp)) * scenario_.lidar.T_imu_lidar();
      const Pose T_true_cloud = T_W_L * (cloud->T_W_I * calibration.T_imu_lidar).inverse();
      for (std::size_t i = 0, j = 0; i < sweep.scan.points.size() && j < cloud->points_W.size(); i += stride, ++j) {
        addPoint(sweep, i, T_true_cloud * cloud->points_W[j].cast<double>(), T_W_L);
      }
    }
  }

  void addPoint(const sim::SimulatedScan& sweep, std::size_t i, const Eigen::Vector3d& ours_W, const Pose& T_W_L) {
    if (sweep.surface[i] < 0) return;
    const Plane plane = scene_->rectangles()[static_cast<std::size_t>(sweep.surface[i])].plane();
    const LidarPoint& point = sweep.scan.points[i];
    const double t = trajectory_->timeOf(sweep.scan.stamp) + scenario_.lidar.time_offset_s + point.offset_s;
    const Eigen::Vector3d p_L = point.p.cast<double>();
    deskew_.ours.add(plane.distance(ours_W));
    deskew_.truth.add(plane.distance(trajectory_->T_W_I(t) * scenario_.lidar.T_imu_lidar() * p_L));
    deskew_.untouched.add(plane.distance(T_W_L * p_L));
  }

  void printHeader() {
    const char* header =
        "t_s,rotation_mrad,rotation_sigma_mrad,translation_mm,translation_sigma_mm,offset_us,nees,deskew_mm,true_mm,"
        "none_mm,"
        "planes,cpu_s,resident_mb\n";
    std::printf("%s", header);
    if (csv_) csv_ << header;
  }

  void printLine(double t) {
    const CalibrationEstimate e =
        with_fuser_ && fuser_->estimate().lidar.valid ? fuser_->estimate() : calibrator_->estimate();
    const Vector6d error = e.calibration.T_imu_lidar.minus(scenario_.lidar.T_imu_lidar());
    const double offset = e.calibration.lidar_time_offset_s - scenario_.lidar.time_offset_s;
    char line[320];
    std::snprintf(line, sizeof line, "%.0f,%.4f,%.4f,%.4f,%.4f,%.1f,%.2f,%.3f,%.3f,%.3f,%d,%.3f,%.1f\n", t,
                  1e3 * error.tail<3>().norm(), 1e3 * e.lidar.sigma.tail<3>().norm(), 1e3 * error.head<3>().norm(),
                  1e3 * e.lidar.sigma.head<3>().norm(), 1e6 * offset, nees(e, error, offset), 1e3 * deskew_.ours.rms(),
                  1e3 * deskew_.truth.rms(), 1e3 * deskew_.untouched.rms(),
                  static_cast<int>(calibrator_->diagnostics().counts["planes"]), cpu_s_, residentMegabytes());
    std::printf("%s", line);
    std::fflush(stdout);
    if (csv_) csv_ << line;
    deskew_ = DeskewQuality();
    cpu_s_ = 0.0;
  }

  /// Squared error of the lidar's pose and offset in the estimate's own measure: 7 on average if it is honest.
  static double nees(const CalibrationEstimate& estimate, const Vector6d& pose, double offset) {
    if (!estimate.lidar.valid) return 0.0;
    const Matrix14d& P = estimate.covariance;
    Eigen::Matrix<double, 7, 7> C;
    C << P.block<6, 6>(6, 6), P.block<6, 1>(6, 13), P.block<1, 6>(13, 6), P(13, 13);
    Eigen::Matrix<double, 7, 1> error;
    error << pose, offset;
    return error.dot(C.ldlt().solve(error));
  }

  sim::Scenario scenario_;
  bool with_fuser_;
  int max_points_ = 0;
  std::optional<sim::Scene> scene_;
  std::optional<sim::Trajectory> trajectory_;
  std::optional<LidarInertialCalibrator> calibrator_;
  std::optional<CoCalibrationFuser> fuser_;
  std::vector<sim::SimulatedScan> sweeps_;
  TimeNs last_cloud_ = 0;
  DeskewQuality deskew_;
  double cpu_s_ = 0.0;
  std::ofstream csv_;
};

}  // namespace

int main(int argc, char** argv) {
  Arguments arguments;
  return bench::runProgram("bench_deskew", argc, argv, describe(&arguments), [&] { Run(arguments).run(); });
}
