#include "cocalib/calibrators/cocalibration_fuser.h"

#include <utility>

#include "cocalib/calibrators/separate_estimates.h"
#include "cocalib/measurements/validity.h"
#include "cocalibration_fuser_impl.h"

namespace cocalib {

CoCalibrationFuser::CoCalibrationFuser(const FuserParams& params, const ImuNoise& imu_noise,
                                       const FuserInputs& inputs) {
  params.validate();
  impl_ = std::make_unique<Impl>(params, imu_noise, inputs);
  reset();
}
CoCalibrationFuser::~CoCalibrationFuser() = default;

void CoCalibrationFuser::addImu(const ImuSample& sample) { impl_->inbox.push(sample); }

void CoCalibrationFuser::addVisual(VisualKeyframe keyframe) {
  Impl& m = *impl_;
  ++m.diagnostics.counts["visual keyframes"];
  const std::optional<NavState> state = keyframe.state;
  const std::optional<TimeNs> before = m.queues.visual_order.last();
  if (!isUsable(keyframe, m.inputs.board) || !m.queues.add(std::move(keyframe))) {
    ++m.diagnostics.counts["keyframes refused"];
    return;
  }
  m.noteSilence(before, *m.queues.visual_order.last(), "pictures");
  m.remember(state, &m.visual_hints);
  m.boundQueues();
}

void CoCalibrationFuser::addLidar(LidarKeyframe keyframe) {
  Impl& m = *impl_;
  ++m.diagnostics.counts["lidar keyframes"];
  const std::optional<NavState> state = keyframe.state;
  const std::optional<TimeNs> before = m.queues.lidar_order.last();
  if (!isUsable(keyframe) || !m.queues.add(std::move(keyframe))) {
    ++m.diagnostics.counts["keyframes refused"];
    return;
  }
  m.noteSilence(before, *m.queues.lidar_order.last(), "sweeps");
  m.remember(state, &m.lidar_hints);
  m.boundQueues();
}

/// A sensor that was silent for longer than the window: its states would rest on the other one and the IMU alone.
void CoCalibrationFuser::Impl::noteSilence(const std::optional<TimeNs>& before, TimeNs now, const std::string& what) {
  if (!started || !before || toSeconds(now - *before) <= params.live_window_s) return;
  goOnAfter("no " + what + " for longer than the window");
}

/// Before the start one sensor may wait for the other for long: no more than a window of it will be used.
void CoCalibrationFuser::Impl::boundQueues() {
  if (started) return;
  if (!window.imu().empty()) window.imu().forgetBefore(window.imu().lastStamp() - toNs(params.window_s));
  const std::size_t forgotten = queues.forgetOlderThan(params.window_s);
  if (forgotten > 0) diagnostics.counts["keyframes too old"] += forgotten;
}

bool CoCalibrationFuser::setVisualEstimate(const CalibrationEstimate& estimate) {
  if (!isUsable(estimate.calibration.T_imu_camera, estimate.calibration.camera_time_offset_s)) return false;
  impl_->visual_alone = estimate;
  return impl_->relayUnseen();
}

bool CoCalibrationFuser::setLidarEstimate(const CalibrationEstimate& estimate) {
  if (!isUsable(estimate.calibration.T_imu_lidar, estimate.calibration.lidar_time_offset_s)) return false;
  impl_->lidar_alone = estimate;
  return impl_->relayUnseen();
}

bool CoCalibrationFuser::Impl::relayUnseen() {
  if (started || interrupted) return false;
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

bool CoCalibrationFuser::wantsSolve() const {
  const Impl& m = *impl_;
  if (!m.ready()) return false;
  const auto until = m.horizon();
  if (!until) return false;
  if (!m.started) return toSeconds(*until - m.hints().states().front().stamp) >= m.params.first_solve_s;
  return isDue(*until, m.solved_until, m.params.solve_period_s);
}

bool CoCalibrationFuser::solve() {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) {
    reset();
    return false;
  }
  m.published = nullptr;  // until it is linked again
  const bool had_started = m.started;
  if (!m.solveNewData()) return had_started && !m.started;  // then it begins anew, and has said why
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
  estimate.duration_s = toSeconds(estimate.stamp - *first_stamp);
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
  return collectResiduals(*impl_->published);
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
  m.beginAnew(m.params.prior);
  m.queues.clear();
  m.judge.reset();
  m.visual_alone = m.lidar_alone = m.estimate = CalibrationEstimate();
  m.estimate.message = "looking for the mountings: move the rig, and turn it about all three axes";
  m.interrupted = false;
  m.first_stamp.reset();
  m.keyframes = m.board_views = 0;
  m.diagnostics.stage = "looking for the mountings";
  m.diagnostics.message = m.estimate.message;
}

}  // namespace cocalib
