#include "cocalib/calibrators/lidar_inertial_calibrator.h"

#include <algorithm>
#include <deque>

#include "cocalib/calibrators/window_start.h"
#include "cocalib/estimation/inertial_window.h"
#include "cocalib/estimation/observability.h"
#include "cocalib/inertial/imu_inbox.h"
#include "cocalib/initialization/open_start.h"
#include "cocalib/lidar/lidar_odometry.h"

namespace cocalib {
namespace {

constexpr double kFirstTry_s = 4.0;  // of odometry, before the first attempt at a mounting
constexpr double kTryPeriod_s = 1.0;
constexpr double kOpenShare = 0.8;        // of initialization_s without success, before a part may stay open
constexpr std::size_t kFewestPoses = 30;  // to say that the motion, not the data, is what is missing
constexpr double kStartSlacks_m[] = {0.15, 0.05, 0.02, 0.0};
constexpr int kStartIterations = 6;
constexpr int kIterations = 2;
constexpr double kMapSpacing_s = 0.5;  // between the sweeps that make up the published map

/// Part of the sweep, in order of time.
std::shared_ptr<const LidarScan> subsample(const LidarScan& scan, int max_points) {
  auto out = std::make_shared<LidarScan>();
  out->stamp = scan.stamp;
  std::size_t stride = scan.points.size() / static_cast<std::size_t>(max_points) + 1;
  if (stride % 2 == 0) ++stride;  // lasers come in powers of two: an odd stride visits all of them
  out->points.reserve(scan.points.size() / stride + 1);
  for (std::size_t i = 0; i < scan.points.size(); i += stride) out->points.push_back(scan.points[i]);
  const auto earlier = [](const LidarPoint& a, const LidarPoint& b) { return a.offset_s < b.offset_s; };
  if (!std::is_sorted(out->points.begin(), out->points.end(), earlier)) {
    std::stable_sort(out->points.begin(), out->points.end(), earlier);
  }
  return out;
}

TimeNs endOf(const LidarScan& scan) {
  return scan.points.empty() ? scan.stamp : scan.stamp + toNs(scan.points.back().offset_s);
}

}  // namespace

struct LidarInertialCalibrator::Impl {
  Impl(const LidarInertialParams& p, const ImuNoise& noise, const std::optional<Pose>& g)
      : params(p), guess(g), odometry(odometryParams(p)), window(windowParams(p, noise)) {}

  static LidarOdometry::Params odometryParams(const LidarInertialParams& p) {
    LidarOdometry::Params out;
    out.range_noise_m = p.range_noise_m;
    return out;
  }
  static InertialWindow::Params windowParams(const LidarInertialParams& p, const ImuNoise& noise) {
    InertialWindow::Params out;
    out.imu_noise = noise;
    out.lidar = LidarGroup::Params();
    out.lidar->range_noise_m = p.range_noise_m;
    out.plane_map.point_sigma_m = p.range_noise_m;
    return out;
  }

  void explore(const std::shared_ptr<const LidarScan>& scan);
  bool tryToStart();
  SensorMotion ownMotion() const;
  std::optional<Alignment> align(bool open, std::string* reason);
  void declareUnseen(std::string* reason);
  void startWindow(const Alignment& alignment);
  void advance();
  void solve();
  void publish();
  std::vector<LidarKeyframe> takeKeyframes();

  LidarInertialParams params;
  std::optional<Pose> guess;
  LidarOdometry odometry;
  InertialWindow window;
  ImuInbox inbox;
  bool started = false;
  // Before the start: raw sweeps with their poses in the odometry's frame, newest initialization_s.
  std::deque<std::shared_ptr<const LidarScan>> raw;
  std::deque<LidarOdometry::Result> poses;
  TimeNs last_try = 0;
  // After it: sweeps that wait for inertial data, and those in the window not yet handed on.
  std::deque<std::shared_ptr<const LidarScan>> waiting, unreported;
  TimeNs last_solve = 0;
  std::uint32_t version = 0;
  CalibrationEstimate estimate;
  CalibratorDiagnostics diagnostics;
};

LidarInertialCalibrator::LidarInertialCalibrator(const LidarInertialParams& params, const ImuNoise& imu_noise,
                                                 const std::optional<Pose>& guess_T_imu_lidar) {
  params.validate();
  impl_ = std::make_unique<Impl>(params, imu_noise, guess_T_imu_lidar);
  reset();
}
LidarInertialCalibrator::~LidarInertialCalibrator() = default;

void LidarInertialCalibrator::addImu(const ImuSample& sample) { impl_->inbox.push(sample); }

std::vector<LidarKeyframe> LidarInertialCalibrator::addScan(const LidarScan& scan) {
  Impl& m = *impl_;
  ++m.diagnostics.counts["scans"];
  if (!m.inbox.drainTo(&m.window.imu())) reset();
  if (scan.points.empty()) {
    ++m.diagnostics.counts["empty scans"];
    return {};
  }
  const auto kept = subsample(scan, m.params.max_points);
  if (!m.started) {
    m.explore(kept);
    if (!m.tryToStart()) return {};
    return m.takeKeyframes();
  }
  m.waiting.push_back(kept);
  m.advance();
  return m.takeKeyframes();
}

std::vector<LidarKeyframe> LidarInertialCalibrator::flush() {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) return {};
  if (!m.started) {
    m.last_try = 0;
    if (!m.tryToStart()) return {};
  }
  m.advance();
  if (m.window.state().nodes.back().stamp > m.last_solve) m.solve();
  return m.takeKeyframes();
}

void LidarInertialCalibrator::Impl::explore(const std::shared_ptr<const LidarScan>& scan) {
  if (!raw.empty() && scan->stamp <= raw.back()->stamp) {
    ++diagnostics.counts["scans out of order"];
    return;
  }
  const LidarOdometry::Result result = odometry.addScan(*scan);
  if (!result.good) ++diagnostics.counts["scans not registered"];
  raw.push_back(scan);
  poses.push_back(result);
  while (toSeconds(raw.back()->stamp - raw.front()->stamp) > params.initialization_s) {
    raw.pop_front();
    poses.pop_front();
  }
}

bool LidarInertialCalibrator::Impl::tryToStart() {
  if (poses.empty()) return false;
  const TimeNs now = poses.back().end;
  if (toSeconds(now - poses.front().begin) < kFirstTry_s || toSeconds(now - last_try) < kTryPeriod_s) return false;
  last_try = now;
  std::string reason;
  auto alignment = align(false, &reason);
  if (!alignment && toSeconds(now - poses.front().begin) >= kOpenShare * params.initialization_s) {
    alignment = align(true, &reason);
    if (!alignment) declareUnseen(&reason);
  }
  if (!alignment) {
    diagnostics.message = estimate.message = reason;
    return false;
  }
  returnUnseenToPrior(&*alignment);
  startWindow(*alignment);
  return true;
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
    window.relink(true, slack);
    if (!window.optimize(kStartIterations).failed) window.learnNoise();
  }
  started = true;
  last_solve = last;
  raw.clear();
  poses.clear();
  odometry.reset();
  diagnostics.stage = "refining";
  publish();
}

void LidarInertialCalibrator::Impl::advance() {
  const TimeNs offset = toNs(window.state().calibration.lidar_time_offset_s);
  while (!waiting.empty() && endOf(*waiting.front()) + offset <= window.imu().lastStamp()) {
    const auto scan = waiting.front();
    waiting.pop_front();
    if (scan->stamp + offset < window.state().nodes.front().stamp) continue;
    window.extendTo(endOf(*scan) + offset);
    window.addScan(scan);
    unreported.push_back(scan);
    if (toSeconds(window.state().nodes.back().stamp - last_solve) >= params.solve_period_s) solve();
  }
  window.updateChain();
}

void LidarInertialCalibrator::Impl::solve() {
  last_solve = window.state().nodes.back().stamp;
  window.relink(window.planesAreStale(), 0.02);
  if (window.optimize(kIterations).failed) {
    ++diagnostics.counts["failed solves"];
  } else {
    window.learnNoise();
  }
  const TimeNs oldest = last_solve - toNs(params.window_s);
  if (window.state().nodes.front().stamp < oldest && !window.marginalizeBefore(oldest)) {
    ++diagnostics.counts["failed marginalizations"];
  }
  publish();
}

void LidarInertialCalibrator::Impl::publish() {
  ++version;
  Matrix14d covariance;
  if (!window.calibrationCovariance(&covariance)) {
    ++diagnostics.counts["covariances refused"];
    return;
  }
  const WindowState& state = window.state();
  estimate.stamp = state.nodes.back().stamp;
  estimate.calibration = state.calibration;
  estimate.covariance = covariance;
  estimate.gyro_bias = state.nodes.back().gyro_bias;
  estimate.accel_bias = state.nodes.back().accel_bias;
  estimate.gravity = state.gravity;
  estimate.quality.lidar_plane_rms_m = window.lidar()->planeRms();
  estimate.quality.keyframes = static_cast<int>(state.nodes.size());
  judgeEstimate(false, true, ObservabilityThresholds(), &estimate);
  diagnostics.message = estimate.message;
}

std::vector<LidarKeyframe> LidarInertialCalibrator::Impl::takeKeyframes() {
  std::vector<LidarKeyframe> keyframes;
  const WindowState& state = window.state();
  const TimeNs offset = toNs(state.calibration.lidar_time_offset_s);
  while (!unreported.empty() && endOf(*unreported.front()) + offset <= last_solve) {
    LidarKeyframe keyframe;
    keyframe.scan = *unreported.front();
    const int node = nodeAt(state.nodes, keyframe.scan.stamp + offset);
    keyframe.state = state.nodes[static_cast<std::size_t>(node)];
    keyframes.push_back(std::move(keyframe));
    unreported.pop_front();
  }
  return keyframes;
}

CalibrationEstimate LidarInertialCalibrator::estimate() const { return impl_->estimate; }

std::optional<DeskewedCloud> LidarInertialCalibrator::deskewedCloud() const {
  const Impl& m = *impl_;
  if (!m.started || m.window.lidar()->scans() == 0) return std::nullopt;
  const WindowState& state = m.window.state();
  const int last = m.window.lidar()->scans() - 1;
  DeskewedCloud cloud;
  cloud.stamp = state.nodes.back().stamp;
  cloud.T_W_I = state.nodes.back().T_W_I;
  cloud.sweep = m.window.lidar()->scan(last).stamp;
  cloud.points_W = deskewToWorld(m.window.lidar()->scan(last), state, m.window.chain());
  cloud.plane = m.window.lidar()->planesOf(last);
  cloud.plane.resize(cloud.points_W.size(), -1);
  cloud.calibration = state.calibration;
  cloud.calibration_version = m.version;
  return cloud;
}

std::vector<Eigen::Vector3f> LidarInertialCalibrator::map() const {
  const Impl& m = *impl_;
  std::vector<Eigen::Vector3f> points;
  if (!m.started) return points;
  const TimeNs offset = toNs(m.window.state().calibration.lidar_time_offset_s);
  TimeNs next = 0;
  for (int i = 0; i < m.window.lidar()->scans(); ++i) {
    const LidarScan& scan = m.window.lidar()->scan(i);
    if (scan.stamp < next || scan.stamp + offset < m.window.state().nodes.front().stamp) continue;
    next = scan.stamp + toNs(kMapSpacing_s);
    const auto deskewed = deskewToWorld(scan, m.window.state(), m.window.chain());
    points.insert(points.end(), deskewed.begin(), deskewed.end());
  }
  return points;
}

void LidarInertialCalibrator::setJointCalibration(const Calibration& calibration) {
  Impl& m = *impl_;
  if (!m.started) return;
  Calibration own = m.window.state().calibration;
  own.T_imu_lidar = calibration.T_imu_lidar;
  own.lidar_time_offset_s = calibration.lidar_time_offset_s;
  m.window.setLinearization(own);
  ++m.version;
}

CalibratorDiagnostics LidarInertialCalibrator::diagnostics() const {
  CalibratorDiagnostics out = impl_->diagnostics;
  if (impl_->started) out.counts["planes"] = impl_->window.planesInUse();
  out.counts["imu samples dropped"] = impl_->inbox.dropped();
  out.counts["imu samples refused"] = impl_->inbox.refused();
  return out;
}

void LidarInertialCalibrator::reset() {
  Impl& m = *impl_;
  m.window.imu().clear();
  m.odometry.reset();
  m.started = false;
  m.raw.clear();
  m.poses.clear();
  m.waiting.clear();
  m.unreported.clear();
  m.last_try = m.last_solve = 0;
  m.version = 0;
  m.estimate = CalibrationEstimate();
  m.diagnostics.stage = "waiting for imu";
  m.diagnostics.message = m.estimate.message = "waiting for inertial data and sweeps";
}

}  // namespace cocalib
