// How the LidarInertialCalibrator finds the mounting: odometry, alignment, the first window.

#include <algorithm>

#include "cocalib/calibrators/window_start.h"
#include "cocalib/estimation/observability.h"
#include "lidar_inertial_impl.h"

namespace cocalib {
namespace {

constexpr double kFirstTry_s = 4.0;  // of odometry, before the first attempt at a mounting
constexpr double kTryPeriod_s = 1.0;
constexpr double kOpenShare = 0.8;        // of initialization_s without success, before a part may stay open
constexpr std::size_t kFewestPoses = 30;  // to say that the motion, not the data, is what is missing
constexpr double kStartSlacks_m[] = {0.15, 0.05, 0.02, 0.0};
constexpr int kStartIterations = 6;

}  // namespace

void LidarInertialCalibrator::Impl::explore(const std::shared_ptr<const LidarScan>& scan) {
  const LidarOdometry::Result result = odometry.addScan(*scan);
  if (!result.good) ++diagnostics.counts["scans not registered"];
  raw.push_back(scan);
  poses.push_back(result);
  while (toSeconds(raw.back()->stamp - raw.front()->stamp) > params.initialization_s) {
    raw.pop_front();
    poses.pop_front();
  }
}

/// Sweeps from before the inertial data, or before a gap in them, can show nothing of the mounting.
void LidarInertialCalibrator::Impl::forgetUselessSweeps() {
  if (poses.empty()) return;
  const TimeNs first = forgetUselessImu(poses.front().begin, poses.back().end, &window.imu());
  while (!poses.empty() && poses.front().begin < first) {
    raw.pop_front();
    poses.pop_front();
  }
}

bool LidarInertialCalibrator::Impl::tryToStart() {
  forgetUselessSweeps();
  if (poses.empty()) return false;
  const TimeNs now = poses.back().end;
  if (toSeconds(now - poses.front().begin) < kFirstTry_s || toSeconds(now - last_try) < kTryPeriod_s / effort)
    return false;
  last_try = now;
  std::string reason;
  auto alignment = align(false, &reason);
  if (!alignment && toSeconds(now - poses.front().begin) >= kOpenShare * params.initialization_s) {
    alignment = align(true, &reason);
    if (!alignment) declareUnseen(&reason);
  }
  if (!alignment) {
    diagnostics.message = estimate.message = why_anew.empty() ? reason : why_anew + "; " + reason;
    return false;
  }
  returnUnseenToPrior(window.imu(), &*alignment);
  startWindow(*alignment);
  return started;
}

SensorMotion LidarInertialCalibrator::Impl::ownMotion() const {
  SensorMotion motion;
  for (std::size_t i = 0; i < poses.size(); ++i) {
    if (!poses[i].good) continue;
    const TimeNs stamp = poses[i].begin + (poses[i].end - poses[i].begin) / 2;
    motion.poses.push_back({stamp, poses[i].at(0.5), poses[i].seen_directions});
    if (i == 0 || !poses[i - 1].good) continue;
    const SensorPose& before = motion.poses[motion.poses.size() - 2];
    motion.rotations.push_back({before.stamp, stamp, before.T_M_S.q.conjugate() * motion.poses.back().T_M_S.q});
  }
  return motion;
}

/// @param open  take the guess, or a broad prior, for what the motion leaves open; otherwise it must show everything
std::optional<Alignment> LidarInertialCalibrator::Impl::align(bool open, std::string* reason) {
  const SensorMotion motion = ownMotion();
  if (open) {
    const auto start = openStart(window.imu(), motion, guess, reason);
    if (!start) return std::nullopt;
    return alignFromPoses(window.imu(), start->rotation, motion.poses, start->alignment, reason);
  }
  const auto rotation = initializeRotation(window.imu(), motion.rotations, RotationInitializerParams(), reason);
  diagnostics.stage = rotation ? "rotation found" : "waiting for motion";
  if (!rotation) return std::nullopt;
  return alignFromPoses(window.imu(), *rotation, motion.poses, AlignmentParams(), reason);
}

/// If the data are there: what has been moved, or what has been seen, shows nothing of the mounting.
void LidarInertialCalibrator::Impl::declareUnseen(std::string* reason) {
  const auto fits = std::count_if(poses.begin(), poses.end(), [](const auto& pose) { return pose.registered; });
  const bool imu_there = !window.imu().empty() && window.imu().firstStamp() <= poses.front().end;
  if (static_cast<std::size_t>(fits) < kFewestPoses || !imu_there) return;
  const auto good = std::count_if(poses.begin(), poses.end(), [](const auto& pose) { return pose.good; });
  if (2 * good < fits) {
    *reason =
        "all surfaces that the lidar sees face one way, so that its rotation shows in part only: "
        "move where walls face different ways";
  }
  estimate = unseenEstimate(Sensor::kLidar, guess);
  estimate.stamp = poses.back().end;
  estimate.duration_s = toSeconds(poses.back().end - poses.front().begin);
}

void LidarInertialCalibrator::Impl::startWindow(const Alignment& alignment) {
  Calibration calibration;
  calibration.T_imu_lidar = alignment.T_imu_sensor;
  calibration.lidar_time_offset_s = alignment.time_offset_s;
  startNodes(alignment, calibration, &window);
  const TimeNs first = window.state().nodes.front().stamp;
  const TimeNs last = window.state().nodes.back().stamp;
  const TimeNs offset = toNs(alignment.time_offset_s);
  for (const auto& scan : raw) {
    if (scan->stamp + offset < first) continue;
    if (endOf(*scan) + offset > last) {
      waiting.push_back(scan);
      continue;
    }
    window.addScan(scan);
    unreported.push_back(scan);
  }
  for (const double slack : kStartSlacks_m) {
    window.relink(Relink::kNewPlanes, slack);
    if (!window.optimize(kStartIterations).failed) window.learnNoise();
  }
  started = true;
  last_solve = last;
  solved = unreported.size();
  raw.clear();
  poses.clear();
  odometry.reset();
  if (!isPossible(window.state())) return restart("the sweeps contradict the inertial data");
  why_anew.clear();
  diagnostics.stage = "refining";
  publish();
}

}  // namespace cocalib
