#include "cocalib/calibrators/cocalibration_fuser.h"

#include <algorithm>
#include <cmath>
#include <deque>

#include "cocalib/estimation/inertial_window.h"
#include "cocalib/estimation/observability.h"
#include "cocalib/inertial/imu_inbox.h"

namespace cocalib {
namespace {

// The first solve starts from the sub-calibrators' states, centimetres off; each round closes the gates further.
constexpr double kFirstSlacks_m[] = {0.10, 0.03, 0.01};
constexpr int kFirstIterations = 6;
constexpr int kIterations = 3;
constexpr int kFinalRounds = 2;
constexpr int kFinalIterations = 10;

InertialWindow::Params windowParams(const FuserParams& params, const ImuNoise& noise, const FuserInputs& inputs) {
  InertialWindow::Params window;
  window.imu_noise = noise;
  if (inputs.camera) {
    CameraGroup::Params camera(*inputs.camera);
    camera.board = inputs.board;
    camera.corner_sigma_px = params.corner_sigma_px;
    camera.track_sigma_px = params.track_sigma_px;
    window.camera = camera;
  }
  if (inputs.lidar) {
    LidarGroup::Params lidar;
    lidar.range_noise_m = params.range_noise_m;
    if (inputs.camera) lidar.board = inputs.board;
    window.lidar = lidar;
    window.plane_map.point_sigma_m = params.range_noise_m;
  }
  return window;
}

}  // namespace

struct CoCalibrationFuser::Impl {
  Impl(const FuserParams& p, const ImuNoise& noise, const FuserInputs& in)
      : params(p), inputs(in), window(windowParams(p, noise, in)) {}

  bool ready() const;
  std::optional<TimeNs> horizon() const;
  const std::deque<NavState>& hints() const { return inputs.lidar ? lidar_hints : visual_hints; }
  NavState hintAt(TimeNs stamp) const;
  Pose alignmentToWindow() const;
  bool start();
  void extend(TimeNs until);
  bool takeNewData();
  void solveFirst();
  void rememberHint(const std::optional<NavState>& state, std::deque<NavState>* hints) const;
  void solveRound(bool rebuild, double slack_m, int iterations);
  void publish();

  FuserParams params;
  FuserInputs inputs;
  InertialWindow window;
  ImuInbox inbox;
  std::deque<VisualKeyframe> visual;
  std::deque<LidarKeyframe> lidar;
  std::deque<NavState> visual_hints, lidar_hints;
  CalibrationEstimate visual_start, lidar_start, estimate;
  bool started = false;
  TimeNs first_stamp = 0, solved_until = 0;
  int planes_built_at_scans = 0;
  CalibratorDiagnostics diagnostics;
};

CoCalibrationFuser::CoCalibrationFuser(const FuserParams& params, const ImuNoise& imu_noise,
                                       const FuserInputs& inputs) {
  params.validate();
  impl_ = std::make_unique<Impl>(params, imu_noise, inputs);
  reset();
}
CoCalibrationFuser::~CoCalibrationFuser() = default;

void CoCalibrationFuser::addImu(const ImuSample& sample) { impl_->inbox.push(sample); }

void CoCalibrationFuser::addVisual(VisualKeyframe keyframe) {
  ++impl_->diagnostics.counts["visual keyframes"];
  impl_->rememberHint(keyframe.state, &impl_->visual_hints);
  impl_->visual.push_back(std::move(keyframe));
  while (!impl_->started && impl_->visual.back().stamp - impl_->visual.front().stamp > toNs(impl_->params.window_s)) {
    impl_->visual.pop_front();  // the other sensor has not started for a whole window
    ++impl_->diagnostics.counts["visual keyframes too old"];
  }
}

void CoCalibrationFuser::addLidar(LidarKeyframe keyframe) {
  ++impl_->diagnostics.counts["lidar keyframes"];
  impl_->rememberHint(keyframe.state, &impl_->lidar_hints);
  impl_->lidar.push_back(std::move(keyframe));
  while (!impl_->started &&
         impl_->lidar.back().scan.stamp - impl_->lidar.front().scan.stamp > toNs(impl_->params.window_s)) {
    impl_->lidar.pop_front();
    ++impl_->diagnostics.counts["lidar keyframes too old"];
  }
}

void CoCalibrationFuser::setVisualEstimate(const CalibrationEstimate& estimate) { impl_->visual_start = estimate; }
void CoCalibrationFuser::setLidarEstimate(const CalibrationEstimate& estimate) { impl_->lidar_start = estimate; }

void CoCalibrationFuser::Impl::rememberHint(const std::optional<NavState>& state, std::deque<NavState>* hints) const {
  if (state && (hints->empty() || state->stamp > hints->back().stamp)) hints->push_back(*state);
  // Only those after the last node will be asked for.
  while (started && hints->size() > 1 && (*hints)[1].stamp <= window.state().nodes.back().stamp) hints->pop_front();
}

bool CoCalibrationFuser::Impl::ready() const {
  const bool camera_ready = !inputs.camera || visual_start.camera.valid;
  const bool lidar_ready = !inputs.lidar || lidar_start.lidar.valid;
  return camera_ready && lidar_ready && !hints().empty();
}

std::optional<TimeNs> CoCalibrationFuser::Impl::horizon() const {
  std::optional<TimeNs> until;
  const auto limit = [&](TimeNs stamp) { until = until ? std::min(*until, stamp) : stamp; };
  const Calibration& c = window.state().calibration;
  if (inputs.camera) {
    if (visual.empty()) return std::nullopt;
    const double offset = started ? c.camera_time_offset_s : visual_start.calibration.camera_time_offset_s;
    limit(visual.back().stamp + toNs(offset));
  }
  if (inputs.lidar) {
    if (lidar.empty()) return std::nullopt;
    const LidarScan& scan = lidar.back().scan;
    const double offset = started ? c.lidar_time_offset_s : lidar_start.calibration.lidar_time_offset_s;
    limit(scan.stamp + toNs(offset + (scan.points.empty() ? 0.0 : scan.points.back().offset_s)));
  }
  return until;
}

bool CoCalibrationFuser::wantsSolve() const {
  const Impl& m = *impl_;
  if (!m.ready()) return false;
  const auto until = m.horizon();
  if (!until) return false;
  if (!m.started) return toSeconds(*until - m.hints().front().stamp) >= m.params.first_solve_s;
  // A solve costs in proportion to the data in the window, so its period grows with it: the total stays linear.
  const double period = std::max(m.params.solve_period_s, 0.2 * toSeconds(m.solved_until - m.first_stamp));
  return toSeconds(*until - m.solved_until) >= std::min(period, 2.0 * m.params.solve_period_s);
}

NavState CoCalibrationFuser::Impl::hintAt(TimeNs stamp) const {
  const std::deque<NavState>& all = hints();
  const auto after =
      std::upper_bound(all.begin(), all.end(), stamp, [](TimeNs t, const NavState& s) { return t < s.stamp; });
  const NavState& hint = after == all.begin() ? all.front() : *std::prev(after);
  std::vector<ImuSample> samples = window.imu().slice(hint.stamp, stamp);
  if (samples.size() < 2) return hint;
  const Preintegration segment(std::move(samples), ImuNoise(), hint.gyro_bias, hint.accel_bias);
  return propagate(segment, hint, window.state().gravity, stamp);
}

/// Both worlds are gravity-aligned: they differ by a turn about the vertical and a shift, found at the last node.
Pose CoCalibrationFuser::Impl::alignmentToWindow() const {
  const NavState& node = window.state().nodes.back();
  const NavState hint = hintAt(node.stamp);
  const Eigen::Quaterniond turn = node.T_W_I.q * hint.T_W_I.q.conjugate();
  Pose T;
  T.q = Eigen::Quaterniond(turn.w(), 0.0, 0.0, turn.z()).normalized();
  T.t = node.T_W_I.t - T.q * hint.T_W_I.t;
  return T;
}

bool CoCalibrationFuser::Impl::start() {
  if (window.imu().empty()) return false;
  const auto covered = [&](const NavState& s) { return s.stamp >= window.imu().firstStamp(); };
  const auto first = std::find_if(hints().begin(), hints().end(), covered);
  if (first == hints().end()) return false;
  Calibration calibration;
  if (inputs.camera) {
    calibration.T_imu_camera = visual_start.calibration.T_imu_camera;
    calibration.camera_time_offset_s = visual_start.calibration.camera_time_offset_s;
  }
  if (inputs.lidar) {
    calibration.T_imu_lidar = lidar_start.calibration.T_imu_lidar;
    calibration.lidar_time_offset_s = lidar_start.calibration.lidar_time_offset_s;
  }
  const double gravity = inputs.lidar ? lidar_start.gravity : visual_start.gravity;
  // What a start leaves open came from a guess, to about 0.1 m: held to it here too, or noise would move it by metres.
  const bool open = !visual_start.camera.unobservable.empty() || !lidar_start.lidar.unobservable.empty();
  window.setTranslationPrior(open ? 0.1 : WindowPriors().extrinsic_translation_m);
  window.reset(*first, calibration, gravity);
  first_stamp = first->stamp;
  started = true;
  return true;
}

void CoCalibrationFuser::Impl::extend(TimeNs until) {
  const Calibration& c = window.state().calibration;
  const Pose T_window_hint = alignmentToWindow();
  const TimeNs begin = window.state().nodes.front().stamp;
  const auto addNodeAt = [&](TimeNs stamp) {
    const NavState& last = window.state().nodes.back();
    if (stamp <= last.stamp) return;
    NavState node = hintAt(stamp);
    if (node.stamp != stamp) return;  // no inertial data there
    node.T_W_I = T_window_hint * node.T_W_I;
    node.v_W = T_window_hint.q * node.v_W;
    node.gyro_bias = last.gyro_bias;
    node.accel_bias = last.accel_bias;
    window.addNode(node);
  };
  // A node at every picture, and between them where pictures are rare: measurements then stay near a node.
  constexpr TimeNs kSpacing = 50000000;
  const auto fillTo = [&](TimeNs stamp) {
    const TimeNs from = window.state().nodes.back().stamp;
    const auto steps = static_cast<int>((stamp - from + kSpacing / 2) / kSpacing);
    for (int i = 1; i <= steps; ++i) addNodeAt(from + (stamp - from) * i / std::max(steps, 1));
    addNodeAt(stamp);
  };
  for (; !visual.empty(); visual.pop_front()) {
    const TimeNs stamp = visual.front().stamp + toNs(c.camera_time_offset_s);
    if (stamp > until) break;
    if (stamp < begin) continue;
    fillTo(stamp);
    window.addFrame(visual.front());
  }
  fillTo(std::min(until, window.imu().lastStamp()));
  for (; !lidar.empty(); lidar.pop_front()) {
    LidarScan& scan = lidar.front().scan;
    if (scan.points.empty()) continue;
    const TimeNs stamp = scan.stamp + toNs(c.lidar_time_offset_s);
    if (stamp + toNs(scan.points.back().offset_s) > until) break;
    if (stamp >= begin) window.addScan(std::make_shared<const LidarScan>(std::move(scan)));
  }
  solved_until = until;
}

void CoCalibrationFuser::Impl::solveRound(bool rebuild, double slack_m, int iterations) {
  window.relink(rebuild, slack_m);
  const InertialWindow::Summary summary = window.optimize(iterations);
  if (summary.failed) {
    ++diagnostics.counts["failed solves"];
  } else {
    window.learnNoise();
  }
}

/// Takes in all data up to the horizon. @return whether there is anything new to solve for
bool CoCalibrationFuser::Impl::takeNewData() {
  if (!ready() || (!started && !start())) return false;
  const auto until = horizon();
  if (!until || *until <= window.state().nodes.back().stamp) return false;
  extend(std::min(*until, window.imu().lastStamp()));
  return true;
}

void CoCalibrationFuser::Impl::solveFirst() {
  for (const double slack : kFirstSlacks_m) solveRound(true, slack, kFirstIterations);
  planes_built_at_scans = window.lidar() ? window.lidar()->scans() : 0;
}

bool CoCalibrationFuser::solve() {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) {
    reset();
    return false;
  }
  const bool first = !m.started;
  if (!m.takeNewData()) return false;
  if (first) {
    m.solveFirst();
  } else {
    const int scans = m.window.lidar() ? m.window.lidar()->scans() : 0;
    const bool rebuild = scans > 3 * m.planes_built_at_scans / 2;
    if (rebuild) m.planes_built_at_scans = scans;
    m.solveRound(rebuild, 0.005, kIterations);
  }
  m.publish();
  const TimeNs oldest = m.window.state().nodes.back().stamp - toNs(m.params.window_s);
  if (m.window.state().nodes.front().stamp < oldest) m.window.marginalizeBefore(oldest);
  return true;
}

void CoCalibrationFuser::finish(const std::function<void(double)>& progress) {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) return;
  const bool first = !m.started;
  if (m.takeNewData() && first) m.solveFirst();
  for (int round = 0; m.started && round < kFinalRounds; ++round) {
    if (progress) progress(static_cast<double>(round) / kFinalRounds);
    m.solveRound(true, round == 0 ? 0.005 : 0.0, kFinalIterations);
  }
  if (m.started) m.publish();
  if (progress) progress(1.0);
}

void CoCalibrationFuser::Impl::publish() {
  const WindowState& state = window.state();
  Matrix14d covariance;
  if (!window.calibrationCovariance(&covariance)) {
    ++diagnostics.counts["covariances refused"];
    return;
  }
  estimate.stamp = state.nodes.back().stamp;
  estimate.duration_s = toSeconds(state.nodes.back().stamp - first_stamp);
  estimate.calibration = state.calibration;
  estimate.covariance = covariance;
  estimate.gyro_bias = state.nodes.back().gyro_bias;
  estimate.accel_bias = state.nodes.back().accel_bias;
  estimate.gravity = state.gravity;
  estimate.quality.keyframes = static_cast<int>(state.nodes.size());
  if (const CameraGroup* camera = window.camera()) {
    estimate.quality.board_views = camera->boardViews();
    estimate.quality.reprojection_rms_px = camera->sawBoard() ? camera->cornerRms() : camera->trackRms();
  }
  if (const LidarGroup* scans = window.lidar()) {
    estimate.quality.lidar_plane_rms_m = scans->planeRms();
    estimate.quality.board_lidar_points = scans->boardPoints();
  }
  judgeEstimate(inputs.camera.has_value(), inputs.lidar, ObservabilityThresholds(), &estimate);
  diagnostics.stage = toString(estimate.status);
  diagnostics.message = estimate.message;
}

CalibrationEstimate CoCalibrationFuser::estimate() const { return impl_->estimate; }

std::optional<Pose> CoCalibrationFuser::boardPose() const {
  if (!impl_->started || !impl_->window.boardKnown()) return std::nullopt;
  return impl_->window.state().T_W_B;
}

std::optional<NavState> CoCalibrationFuser::latestState() const {
  if (!impl_->started) return std::nullopt;
  return impl_->window.state().nodes.back();
}

CalibratorDiagnostics CoCalibrationFuser::diagnostics() const {
  CalibratorDiagnostics out = impl_->diagnostics;
  out.counts["imu samples dropped"] = impl_->inbox.dropped();
  out.counts["imu samples refused"] = impl_->inbox.refused();
  return out;
}

void CoCalibrationFuser::reset() {
  Impl& m = *impl_;
  m.window.imu().clear();
  m.visual.clear();
  m.lidar.clear();
  m.visual_hints.clear();
  m.lidar_hints.clear();
  m.visual_start = m.lidar_start = m.estimate = CalibrationEstimate();
  m.estimate.message = "waiting for the calibrators to find their sensors";
  m.started = false;
  m.planes_built_at_scans = 0;
  m.diagnostics.stage = "waiting for the calibrators";
  m.diagnostics.message = m.estimate.message;
}

}  // namespace cocalib
