#include "cocalib/calibrators/cocalibration_fuser.h"

#include <algorithm>
#include <cmath>
#include <deque>

#include "cocalib/calibrators/convergence_judge.h"
#include "cocalib/calibrators/keyframe_queues.h"
#include "cocalib/calibrators/separate_estimates.h"
#include "cocalib/calibrators/state_hints.h"
#include "cocalib/calibrators/window_estimate.h"
#include "cocalib/calibrators/window_record.h"
#include "cocalib/estimation/inertial_window.h"
#include "cocalib/estimation/observability.h"
#include "cocalib/inertial/imu_inbox.h"

namespace cocalib {
namespace {

// The first solve starts from the sub-calibrators' states, centimetres off; each round closes the gates further.
constexpr double kFirstSlacks_m[] = {0.10, 0.03, 0.01};
constexpr int kFirstIterations = 6;
constexpr int kIterations = 2;  // a second: the next one goes on from here
constexpr double kSlack_m = 0.005;

InertialWindow::Params windowParams(const FuserParams& params, const ImuNoise& noise, const FuserInputs& inputs) {
  InertialWindow::Params window;
  window.imu_noise = noise;
  if (inputs.camera) {
    CameraGroup::Params camera(*inputs.camera);
    camera.board = inputs.board;
    camera.corner_sigma_px = params.corner_sigma_px;
    camera.track_noise.sigma_px = params.track_sigma_px;
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
      : params(p),
        imu_noise(noise),
        inputs(in),
        window(windowParams(p, noise, in)),
        record(windowParams(p, noise, in), p.window_s),
        judge(in.camera.has_value(), in.lidar) {}

  bool relayUnseen();
  bool ready() const;
  std::optional<TimeNs> horizon() const;
  const StateHints& hints() const { return inputs.lidar ? lidar_hints : visual_hints; }
  void boundQueues();
  void remember(const std::optional<NavState>& state, StateHints* hints) const;
  bool start();
  void extend(TimeNs until);
  bool takeNewData();
  bool solveNewData();
  void solveRound(Relink what, double slack_m, int iterations);
  void slide(TimeNs oldest);
  void publish(InertialWindow* from);

  FuserParams params;
  ImuNoise imu_noise;
  FuserInputs inputs;
  InertialWindow window;  // the newest seconds, with a prior for what came before: solved once a second
  WindowRecord record;    // everything, for the last word
  ImuInbox inbox;
  KeyframeQueues queues;
  StateHints visual_hints, lidar_hints;
  CalibrationEstimate visual_alone, lidar_alone, estimate;
  ConvergenceJudge judge;
  const InertialWindow* published = nullptr;  // where the estimate is from
  bool started = false;
  TimeNs first_stamp = 0, solved_until = 0;
  int keyframes = 0, board_views = 0;
  CalibratorDiagnostics diagnostics;
};

CoCalibrationFuser::CoCalibrationFuser(const FuserParams& params, const ImuNoise& imu_noise,
                                       const FuserInputs& inputs) {
  params.validate();
  impl_ = std::make_unique<Impl>(params, imu_noise, inputs);
  if (params.prior) {
    impl_->window.setCalibrationPrior(*params.prior);
    impl_->record.window().setCalibrationPrior(*params.prior);
  }
  reset();
}
CoCalibrationFuser::~CoCalibrationFuser() = default;

void CoCalibrationFuser::addImu(const ImuSample& sample) { impl_->inbox.push(sample); }

void CoCalibrationFuser::addVisual(VisualKeyframe keyframe) {
  Impl& m = *impl_;
  ++m.diagnostics.counts["visual keyframes"];
  m.remember(keyframe.state, &m.visual_hints);
  m.queues.visual.push_back(std::move(keyframe));
  m.boundQueues();
}

void CoCalibrationFuser::addLidar(LidarKeyframe keyframe) {
  Impl& m = *impl_;
  ++m.diagnostics.counts["lidar keyframes"];
  m.remember(keyframe.state, &m.lidar_hints);
  m.queues.lidar.push_back(std::move(keyframe));
  m.boundQueues();
}

/// Before the start one sensor may wait for the other for long: no more than a window of it will be used.
void CoCalibrationFuser::Impl::boundQueues() {
  if (started) return;
  const std::size_t forgotten = queues.forgetOlderThan(params.window_s);
  if (forgotten > 0) diagnostics.counts["keyframes too old"] += forgotten;
}

bool CoCalibrationFuser::setVisualEstimate(const CalibrationEstimate& estimate) {
  impl_->visual_alone = estimate;
  return impl_->relayUnseen();
}

bool CoCalibrationFuser::setLidarEstimate(const CalibrationEstimate& estimate) {
  impl_->lidar_alone = estimate;
  return impl_->relayUnseen();
}

bool CoCalibrationFuser::Impl::relayUnseen() {
  if (started) return false;
  const auto alone = unseenSideBySide(inputs.camera ? &visual_alone : nullptr, inputs.lidar ? &lidar_alone : nullptr);
  if (!alone) return false;
  estimate = *alone;
  diagnostics.message = estimate.message;
  return true;
}

void CoCalibrationFuser::Impl::remember(const std::optional<NavState>& state, StateHints* hints) const {
  hints->add(state);
  if (started) hints->forgetBefore(window.state().nodes.back().stamp);  // only later ones will be asked for
}

bool CoCalibrationFuser::Impl::ready() const {
  const bool camera_ready = !inputs.camera || isSeen(visual_alone.camera);
  const bool lidar_ready = !inputs.lidar || isSeen(lidar_alone.lidar);
  return camera_ready && lidar_ready && !hints().empty();
}

std::optional<TimeNs> CoCalibrationFuser::Impl::horizon() const {
  const Calibration& camera = started ? window.state().calibration : visual_alone.calibration;
  const Calibration& scanner = started ? window.state().calibration : lidar_alone.calibration;
  return queues.horizon(inputs.camera ? std::optional<double>(camera.camera_time_offset_s) : std::nullopt,
                        inputs.lidar ? std::optional<double>(scanner.lidar_time_offset_s) : std::nullopt);
}

bool CoCalibrationFuser::wantsSolve() const {
  const Impl& m = *impl_;
  if (!m.ready()) return false;
  const auto until = m.horizon();
  if (!until) return false;
  if (!m.started) return toSeconds(*until - m.hints().states().front().stamp) >= m.params.first_solve_s;
  return isDue(*until, m.solved_until, m.params.solve_period_s);
}

bool CoCalibrationFuser::Impl::start() {
  if (window.imu().empty()) return false;
  const std::deque<NavState>& states = hints().states();
  const auto covered = [&](const NavState& s) { return s.stamp >= window.imu().firstStamp(); };
  const auto first = std::find_if(states.begin(), states.end(), covered);
  if (first == states.end()) return false;
  Calibration calibration;
  if (inputs.camera) {
    calibration.T_imu_camera = visual_alone.calibration.T_imu_camera;
    calibration.camera_time_offset_s = visual_alone.calibration.camera_time_offset_s;
  }
  if (inputs.lidar) {
    calibration.T_imu_lidar = lidar_alone.calibration.T_imu_lidar;
    calibration.lidar_time_offset_s = lidar_alone.calibration.lidar_time_offset_s;
  }
  const double gravity = inputs.lidar ? lidar_alone.gravity : visual_alone.gravity;
  window.setTranslationPriors(leverPrior(visual_alone.camera), leverPrior(lidar_alone.lidar));
  record.setTranslationPriors(leverPrior(visual_alone.camera), leverPrior(lidar_alone.lidar));
  window.reset(*first, calibration, gravity);
  first_stamp = first->stamp;
  started = true;
  return true;
}

void CoCalibrationFuser::Impl::extend(TimeNs until) {
  const Calibration& c = window.state().calibration;
  const TimeNs begin = window.state().nodes.front().stamp;
  HintedNodes nodes(hints(), &window);
  std::deque<VisualKeyframe>& visual = queues.visual;
  for (; !visual.empty(); visual.pop_front()) {
    const TimeNs stamp = visual.front().stamp + toNs(c.camera_time_offset_s);
    if (stamp > until) break;
    if (stamp < begin) continue;
    nodes.fillTo(stamp);
    window.addFrame(visual.front());
    record.keep(visual.front());
    ++keyframes;
    if (visual.front().board) ++board_views;
  }
  nodes.fillTo(std::min(until, window.imu().lastStamp()));
  std::deque<LidarKeyframe>& lidar = queues.lidar;
  for (; !lidar.empty(); lidar.pop_front()) {
    LidarScan& scan = lidar.front().scan;
    if (scan.points.empty()) continue;
    const TimeNs stamp = scan.stamp + toNs(c.lidar_time_offset_s);
    if (stamp + toNs(scan.points.back().offset_s) > until) break;
    if (stamp < begin) continue;
    const auto shared = std::make_shared<const LidarScan>(std::move(scan));
    window.addScan(shared);
    record.keep(shared);
    ++keyframes;
  }
  solved_until = until;
}

void CoCalibrationFuser::Impl::solveRound(Relink what, double slack_m, int iterations) {
  window.relink(what, slack_m);
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

/// @return false if there is nothing new
bool CoCalibrationFuser::Impl::solveNewData() {
  const bool first = !started;
  if (!takeNewData()) return false;
  if (first) {
    for (const double slack : kFirstSlacks_m) solveRound(Relink::kNewPlanes, slack, kFirstIterations);
  } else {
    solveRound(window.neededRelink(), kSlack_m, kIterations);
  }
  return true;
}

/// Hands what is older to the record and turns it into a prior.
void CoCalibrationFuser::Impl::slide(TimeNs oldest) {
  if (window.state().nodes.front().stamp >= oldest) return;
  record.take(window, oldest);
  if (!window.marginalizeBefore(oldest)) ++diagnostics.counts["failed marginalizations"];
}

bool CoCalibrationFuser::solve() {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) {
    reset();
    return false;
  }
  m.published = nullptr;  // until it is linked again
  if (!m.solveNewData()) return false;
  m.publish(&m.window);
  m.slide(m.window.state().nodes.back().stamp - toNs(m.params.live_window_s));
  return true;
}

void CoCalibrationFuser::finish(const std::function<void(double)>& progress) {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) return;
  m.solveNewData();
  if (!m.started) return;
  m.record.take(m.window, m.window.state().nodes.back().stamp + 1);
  if (m.record.solve(m.window.state().calibration, progress)) m.publish(&m.record.window());
}

void CoCalibrationFuser::Impl::publish(InertialWindow* from) {
  if (!readEstimate(from, &estimate)) {
    ++diagnostics.counts["covariances refused"];
    return;
  }
  published = from;
  estimate.duration_s = toSeconds(estimate.stamp - first_stamp);
  estimate.quality.keyframes = keyframes;
  if (const CameraGroup* camera = from->camera()) {
    estimate.quality.board_views = board_views;
    estimate.quality.reprojection_rms_px = camera->sawBoard() ? camera->cornerRms() : camera->trackRms();
  }
  if (const LidarGroup* scans = from->lidar()) {
    estimate.quality.lidar_plane_rms_m = scans->planeRms();
    // The live window forgets; what it once had counts.
    estimate.quality.board_lidar_points = std::max(estimate.quality.board_lidar_points, scans->boardPoints());
  }
  judge.judge(visual_alone, lidar_alone, from->cameraScaleUnseen(), &estimate);
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

ResidualSamples CoCalibrationFuser::residuals() const {
  if (!impl_->published) return {};
  return collectResiduals(*impl_->published, impl_->imu_noise);
}

CalibratorDiagnostics CoCalibrationFuser::diagnostics() const {
  CalibratorDiagnostics out = impl_->diagnostics;
  out.counts["imu samples dropped"] = impl_->inbox.dropped();
  out.counts["imu samples refused"] = impl_->inbox.refused();
  out.counts["failed solves of the record"] = impl_->record.failedSolves();
  return out;
}

void CoCalibrationFuser::reset() {
  Impl& m = *impl_;
  m.window.imu().clear();
  m.record.reset();
  m.queues.clear();
  m.visual_hints.clear();
  m.lidar_hints.clear();
  m.judge.reset();
  m.visual_alone = m.lidar_alone = m.estimate = CalibrationEstimate();
  m.estimate.message = "waiting for the calibrators to find their sensors";
  m.published = nullptr;
  m.started = false;
  m.keyframes = m.board_views = 0;
  m.diagnostics.stage = "waiting for the calibrators";
  m.diagnostics.message = m.estimate.message;
}

}  // namespace cocalib
