#include "trial.h"

#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <stdexcept>
#include <utility>
#include <vector>

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/calibrators/visual_inertial_calibrator.h"
#include "cocalib/io/result_file.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "program.h"

namespace cocalib::bench {
namespace {

constexpr TimeNs kNever = std::numeric_limits<TimeNs>::max();

YAML::Node loadYaml(const std::string& path) {
  try {
    return YAML::LoadFile(path);
  } catch (const YAML::Exception& error) {
    throw std::runtime_error(path + ": " + error.what());
  }
}

Pose poseOf(const YAML::Node& node) {
  const auto t = node["translation"].as<std::vector<double>>();
  const auto q = node["rotation_xyzw"].as<std::vector<double>>();
  return {Eigen::Quaterniond(q.at(3), q.at(0), q.at(1), q.at(2)).normalized(), {t.at(0), t.at(1), t.at(2)}};
}

Calibration truthOf(const sim::Scenario& scenario) {
  Calibration truth;
  truth.T_imu_camera = scenario.camera.T_imu_camera();
  truth.T_imu_lidar = scenario.lidar.T_imu_lidar();
  truth.camera_time_offset_s = scenario.camera.time_offset_s;
  truth.lidar_time_offset_s = scenario.lidar.time_offset_s;
  return truth;
}

/// The simulated recording and the three calibrators that it drives, as the bag runner does.
class Run {
 public:
  Run(const sim::Scenario& scenario, const TrialOptions& options)
      : scenario_(scenario),
        options_(options),
        scene_(scenario),
        trajectory_(scenario),
        imu_(sim::simulateImu(scenario, trajectory_)),
        tracks_(scenario, scene_, trajectory_),
        visual_(VisualInertialParams(), noise(), scenario.camera.cameraModel(), board(), {}),
        lidar_(LidarInertialParams(), noise(), {}),
        fuser_(FuserParams(), noise(), inputs()) {}

  Trial run() {
    const int step = std::max(1, static_cast<int>(std::lround(scenario_.camera.rate_hz / options_.image_rate_hz)));
    for (int image = 0, scan = 0;;) {
      const bool more_images = options_.camera && image < sim::imageCount(scenario_);
      const bool more_scans = options_.lidar && scan < sim::scanCount(scenario_);
      if (!more_images && !more_scans) break;
      const double sweep_s = 1.0 / scenario_.lidar.rate_hz;
      const TimeNs image_at = more_images ? sim::imageStamp(scenario_, image) : kNever;
      const TimeNs scan_at =
          more_scans ? scenario_.epoch + toNs((scan + 1) * sweep_s - scenario_.lidar.time_offset_s) : kNever;
      pushImu(std::min(image_at, scan_at));
      if (image_at <= scan_at) {
        addImage(image);
        image += step;
      } else {
        addScan(scan++);
      }
      fuse();
    }
    return finish();
  }

 private:
  ImuNoise noise() const { return {scenario_.imu.gyro_noise_density, 1e-6, scenario_.imu.accel_noise_density, 1e-5}; }
  std::optional<BoardGeometry> board() const {
    return options_.board ? std::optional<BoardGeometry>(scenario_.board.geometry()) : std::nullopt;
  }
  FuserInputs inputs() const {
    FuserInputs in;
    if (options_.camera) in.camera = scenario_.camera.cameraModel();
    in.lidar = options_.lidar;
    in.board = board();
    return in;
  }

  void pushImu(TimeNs until) {
    constexpr TimeNs kAhead = 150000000;  // clock offsets of up to 0.1 s, and what follows a sweep
    for (; next_imu_ < imu_.size() && imu_[next_imu_].stamp <= until + kAhead; ++next_imu_) {
      if (options_.camera) visual_.addImu(imu_[next_imu_]);
      if (options_.lidar) lidar_.addImu(imu_[next_imu_]);
      fuser_.addImu(imu_[next_imu_]);
    }
  }

  void addImage(int k) {
    VisualKeyframe seen;
    seen.stamp = sim::imageStamp(scenario_, k);
    if (options_.board) seen.board = sim::simulateBoard(scenario_, scene_, trajectory_, k);
    if (options_.tracks) seen.tracks = tracks_.observe(k);
    const double begin = processCpu();
    for (VisualKeyframe& keyframe : visual_.addMeasurements(std::move(seen))) fuser_.addVisual(std::move(keyframe));
    fuser_.setVisualEstimate(visual_.estimate());
    trial_.cpu.camera_s += processCpu() - begin;
  }

  void addScan(int k) {
    const LidarScan scan = sim::simulateScan(scenario_, scene_, trajectory_, k).scan;
    const double begin = processCpu();
    for (LidarKeyframe& keyframe : lidar_.addScan(scan)) fuser_.addLidar(std::move(keyframe));
    fuser_.setLidarEstimate(lidar_.estimate());
    trial_.cpu.lidar_s += processCpu() - begin;
  }

  void fuse() {
    if (!fuser_.wantsSolve()) return;
    const double begin = processCpu();
    if (fuser_.solve()) {
      visual_.setJointCalibration(fuser_.estimate().calibration);
      lidar_.setJointCalibration(fuser_.estimate().calibration);
    }
    trial_.cpu.joint_s += processCpu() - begin;
  }

  Trial finish() {
    const double begin = processCpu();
    for (VisualKeyframe& keyframe : visual_.flush()) fuser_.addVisual(std::move(keyframe));
    for (LidarKeyframe& keyframe : lidar_.flush()) fuser_.addLidar(std::move(keyframe));
    fuser_.finish();
    trial_.cpu.last_round_s += processCpu() - begin;
    trial_.truth = truthOf(scenario_);
    trial_.visual = visual_.estimate();
    trial_.lidar = lidar_.estimate();
    trial_.joint = fuser_.estimate();
    return std::move(trial_);
  }

  sim::Scenario scenario_;
  TrialOptions options_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
  std::vector<ImuSample> imu_;
  sim::TrackSimulator tracks_;
  VisualInertialCalibrator visual_;
  LidarInertialCalibrator lidar_;
  CoCalibrationFuser fuser_;
  std::size_t next_imu_ = 0;
  Trial trial_;
};

}  // namespace

Trial runTrial(const sim::Scenario& scenario, const TrialOptions& options) { return Run(scenario, options).run(); }

Trial loadTrial(const std::string& result_dir, const std::string& truth_file) {
  Trial trial;
  trial.joint = loadResult(result_dir + "/calibration.yaml");
  const YAML::Node truth = loadYaml(truth_file);
  if (const YAML::Node camera = truth["camera"]) {
    trial.truth.T_imu_camera = poseOf(camera["T_imu_camera"]);
    trial.truth.camera_time_offset_s = camera["time_offset"].as<double>();
  }
  trial.truth.T_imu_lidar = poseOf(truth["lidar"]["T_imu_lidar"]);
  trial.truth.lidar_time_offset_s = truth["lidar"]["time_offset"].as<double>();
  return trial;
}

}  // namespace cocalib::bench
