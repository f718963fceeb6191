#include "cocalib/calibrators/lidar_inertial_calibrator.h"

#include <algorithm>
#include <utility>

#include "cocalib/calibrators/window_estimate.h"
#include "cocalib/estimation/observability.h"
#include "cocalib/measurements/thinning.h"
#include "cocalib/measurements/validity.h"
#include "lidar_inertial_impl.h"

namespace cocalib {
namespace {

constexpr int kIterations = 2;
constexpr double kSlack_m = 0.02;      // of the states, when points look for their planes
constexpr double kMapSpacing_s = 0.5;  // between the sweeps that make up the published map

/// Part of the sweep, in order of time. @param effort  share of the usual part
std::shared_ptr<const LidarScan> subsample(LidarScan scan, int max_points, double effort) {
  std::vector<LidarPoint>& points = scan.points;
  std::size_t stride = points.size() / static_cast<std::size_t>(max_points) + 1;
  if (stride % 2 == 0) ++stride;  // lasers come in powers of two: an odd stride visits all of them
  if (stride > 1) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < points.size(); i += stride) points[kept++] = points[i];
    points.resize(kept);
    points.shrink_to_fit();
  }
  thin(&scan, effort);
  const auto earlier = [](const LidarPoint& a, const LidarPoint& b) { return a.offset_s < b.offset_s; };
  if (!std::is_sorted(points.begin(), points.end(), earlier)) std::stable_sort(points.begin(), points.end(), earlier);
  return std::make_shared<const LidarScan>(std::move(scan));
}

}  // namespace

LidarInertialCalibrator::LidarInertialCalibrator(const LidarInertialParams& params, const ImuNoise& imu_noise,
                                                 const std::optional<Pose>& guess_T_imu_lidar) {
  params.validate();
  impl_ = std::make_unique<Impl>(params, imu_noise, guess_T_imu_lidar);
  reset();
}
LidarInertialCalibrator::~LidarInertialCalibrator() = default;

void LidarInertialCalibrator::addImu(const ImuSample& sample) { impl_->inbox.push(sample); }

std::vector<LidarKeyframe> LidarInertialCalibrator::addScan(LidarScan scan, const std::function<void()>& look) {
  Impl& m = *impl_;
  ++m.diagnostics.counts["scans"];
  if (!m.inbox.drainTo(&m.window.imu())) reset();
  if (scan.points.empty()) {
    ++m.diagnostics.counts["empty scans"];
    return {};
  }
  const auto kept = subsample(std::move(scan), m.params.max_points, m.effort);
  if (!isUsable(*kept)) {
    ++m.diagnostics.counts["scans with impossible numbers"];
    return {};
  }
  const StampOrder::Verdict order = m.order.take(kept->stamp);
  if (order == StampOrder::Verdict::kSetBack) reset();
  if (order != StampOrder::Verdict::kGood) {
    ++m.diagnostics.counts["scans out of order"];
    return {};
  }
  if (!m.started) {
    m.explore(kept);
    if (!m.tryToStart()) return {};
    return m.takeKeyframes();
  }
  m.waiting.push_back(kept);
  m.advance(look);
  return m.takeKeyframes();
}

void LidarInertialCalibrator::setEffort(double share) { impl_->effort = share; }

std::vector<LidarKeyframe> LidarInertialCalibrator::flush() {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) return {};
  if (!m.started) {
    m.last_try = 0;
    if (!m.tryToStart()) return {};
  }
  m.advance();
  if (m.started && m.window.state().nodes.back().stamp > m.last_solve) m.solve();
  return m.takeKeyframes();
}

void LidarInertialCalibrator::Impl::advance(const std::function<void()>& look) {
  const TimeNs offset = toNs(window.state().calibration.lidar_time_offset_s);
  while (started && !waiting.empty() && endOf(*waiting.front()) + offset <= window.imu().lastStamp()) {
    const auto scan = waiting.front();
    waiting.pop_front();
    if (scan->stamp + offset < window.state().nodes.front().stamp) continue;
    const std::string reason = interruption(window, endOf(*scan) + offset, params.window_s, "sweeps");
    if (!reason.empty()) {
      restart(reason);
      explore(scan);
      break;
    }
    window.extendTo(endOf(*scan) + offset);
    window.addScan(scan);
    unreported.push_back(scan);
    window.relink(Relink::kNewScans, kSlack_m);  // at once: the newest sweep is shown with its planes
    if (look) look();
    if (isDue(window.state().nodes.back().stamp, last_solve, params.solve_period_s)) solve();
  }
  if (started) return;
  for (const auto& scan : waiting) explore(scan);
  waiting.clear();
}

/// Whether the states explain the sweeps after it.
bool LidarInertialCalibrator::Impl::solveWindow() {
  const Relink needed = window.neededRelink();
  if (needed != Relink::kNewScans) window.relink(needed, kSlack_m);
  if (window.optimize(kIterations).failed) return false;
  window.learnNoise();
  return explainsData(window);
}

/// Looks for the mounting anew, as if nothing were known.
void LidarInertialCalibrator::Impl::restart(const std::string& reason) {
  started = false;
  failed.reset();
  last_try = 0;
  raw.clear();
  poses.clear();
  odometry.reset();
  unreported.clear();
  solved = 0;
  sayStartingOver(reason, &estimate, &diagnostics);
  why_anew = estimate.message;
}

void LidarInertialCalibrator::Impl::solve() {
  last_solve = window.state().nodes.back().stamp;
  solved = unreported.size();
  if (failed.note(solveWindow(), &diagnostics)) return restart("the sweeps contradict the inertial data");
  publish();  // first: the covariance is that of the solve, which marginalizing forgets
  const TimeNs oldest = last_solve - toNs(params.window_s);
  if (!window.marginalizeBefore(oldest)) ++diagnostics.counts["failed marginalizations"];
}

void LidarInertialCalibrator::Impl::publish() {
  ++version;
  if (!readEstimate(&window, &estimate)) {
    ++diagnostics.counts["covariances refused"];
    return;
  }
  estimate.quality.lidar_plane_rms_m = window.lidar()->planeRms();
  estimate.quality.keyframes = static_cast<int>(window.state().nodes.size());
  judgeEstimate(false, true, ObservabilityThresholds(), &estimate);
  diagnostics.message = estimate.message;
}

std::vector<LidarKeyframe> LidarInertialCalibrator::Impl::takeKeyframes() {
  std::vector<LidarKeyframe> keyframes;
  const WindowState& state = window.state();
  const TimeNs offset = toNs(state.calibration.lidar_time_offset_s);
  for (; solved > 0; --solved) {
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
  if (!isUsable(calibration.T_imu_lidar, calibration.lidar_time_offset_s)) {
    ++m.diagnostics.counts["feedback refused"];
    return;
  }
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
  m.solved = 0;
  m.last_try = m.last_solve = 0;
  m.order.reset();
  m.failed.reset();
  m.why_anew.clear();
  m.version = 0;
  m.estimate = CalibrationEstimate();
  m.diagnostics.stage = "waiting for imu";
  m.diagnostics.message = m.estimate.message = "waiting for inertial data and sweeps";
}

}  // namespace cocalib
