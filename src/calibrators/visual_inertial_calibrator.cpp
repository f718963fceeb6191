#include "cocalib/calibrators/visual_inertial_calibrator.h"

#include <utility>

#include "cocalib/calibrators/camera_exploration.h"
#include "cocalib/calibrators/window_estimate.h"
#include "cocalib/measurements/validity.h"
#include "visual_inertial_impl.h"

namespace cocalib {
namespace {

constexpr std::size_t kFewFeatures = 20;
constexpr double kRateSlack = 0.9;  // a picture counts as due a little before its time, so that jitter skips none

}  // namespace

VisualInertialCalibrator::VisualInertialCalibrator(const VisualInertialParams& params, const ImuNoise& imu_noise,
                                                   const CameraModel& camera, const std::optional<BoardGeometry>& board,
                                                   const std::optional<Pose>& guess_T_imu_camera) {
  params.validate();
  impl_ = std::make_unique<Impl>(params, imu_noise, camera, board, guess_T_imu_camera);
  reset();
}
VisualInertialCalibrator::~VisualInertialCalibrator() = default;

void VisualInertialCalibrator::addImu(const ImuSample& sample) { impl_->inbox.push(sample); }

std::vector<VisualKeyframe> VisualInertialCalibrator::addImage(const ImageFrame& image) {
  Impl& m = *impl_;
  ++m.diagnostics.counts["images"];
  if (!m.inbox.drainTo(&m.window.imu())) reset();
  if (isTooSoon(image.stamp)) return {};
  if (image.gray.cols != m.camera.width() || image.gray.rows != m.camera.height()) {
    ++m.diagnostics.counts["images of the wrong size"];
    return {};
  }
  if (!takesStamp(image.stamp)) return {};
  m.images.push_back(image);
  return m.keyframesAfterAdvance();
}

std::vector<VisualKeyframe> VisualInertialCalibrator::addMeasurements(VisualKeyframe measured) {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) reset();
  if (!isUsable(measured, m.board)) {
    ++m.diagnostics.counts["images with impossible numbers"];
    return {};
  }
  if (!takesStamp(measured.stamp)) return {};
  m.waiting.push_back(std::move(measured));
  return m.keyframesAfterAdvance();
}

/// Starts over where the camera's clock was set back.
bool VisualInertialCalibrator::takesStamp(TimeNs stamp) {
  const StampOrder::Verdict order = impl_->order.take(stamp);
  if (order == StampOrder::Verdict::kGood) return true;
  ++impl_->diagnostics.counts["images out of order"];
  if (order == StampOrder::Verdict::kSetBack) reset();
  return false;
}

std::vector<VisualKeyframe> VisualInertialCalibrator::Impl::keyframesAfterAdvance() {
  advance();
  if (!started && !tryToStart()) return {};
  return takeKeyframes();
}

std::vector<VisualKeyframe> VisualInertialCalibrator::flush() {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) return {};
  m.advance();
  m.last_try.reset();
  if (!m.started && !m.tryToStart()) return {};
  if (m.window.state().nodes.back().stamp > m.last_solve) m.solve();
  return m.takeKeyframes();
}

/// p_now = R p_prev of the camera between the last processed picture and `stamp`, from the gyro.
std::optional<Eigen::Quaterniond> VisualInertialCalibrator::Impl::predictRotation(TimeNs stamp) const {
  if (!started || !last_tracks) return std::nullopt;
  const Calibration& c = window.state().calibration;
  const TimeNs offset = toNs(c.camera_time_offset_s);
  std::vector<ImuSample> samples = window.imu().slice(*last_tracks + offset, stamp + offset);
  if (samples.size() < 2) return std::nullopt;
  const NavState& newest = window.state().nodes.back();
  const Preintegration segment(std::move(samples), ImuNoise(), newest.gyro_bias, newest.accel_bias);
  const Eigen::Quaterniond& R_I_C = c.T_imu_camera.q;
  return (R_I_C.conjugate() * segment.atEnd().q.conjugate() * R_I_C).normalized();
}

void VisualInertialCalibrator::Impl::predictBoard(TimeNs stamp) {
  if (!started || !window.boardKnown()) return;
  const WindowState& state = window.state();
  const TimeNs at = stamp + toNs(state.calibration.camera_time_offset_s);
  std::vector<ImuSample> samples = window.imu().slice(state.nodes.back().stamp, at);
  if (samples.size() < 2) return;
  const NavState& last = state.nodes.back();
  const Preintegration segment(std::move(samples), ImuNoise(), last.gyro_bias, last.accel_bias);
  const NavState now = propagate(segment, last, state.gravity, at);
  detector->setPredictedPose((now.T_W_I * state.calibration.T_imu_camera).inverse() * state.T_W_B);
}

VisualKeyframe VisualInertialCalibrator::Impl::look(const ImageFrame& image) {
  VisualKeyframe keyframe;
  keyframe.stamp = image.stamp;
  const auto rotation = predictRotation(image.stamp);
  if (detector) {
    predictBoard(image.stamp);
    keyframe.board = detector->detect(image, rotation);
    ++diagnostics.counts[keyframe.board ? "images with board" : "images without board"];
  }
  std::vector<Eigen::Vector2f> outline;
  if (keyframe.board) {
    const auto& c = keyframe.board->corners_px;
    const auto cols = static_cast<std::size_t>(board->cols);
    outline = {c.front(), c[cols - 1], c.back(), c[c.size() - cols]};
  }
  keyframe.tracks = tracker.track(image, rotation, outline);
  last_tracks = image.stamp;
  return keyframe;
}

/// Before the start nothing depends on inertial data; after it a picture waits for its own.
bool VisualInertialCalibrator::Impl::coveredByImu(TimeNs stamp) const {
  const TimeNs offset = toNs(window.state().calibration.camera_time_offset_s);
  return !started || (!window.imu().empty() && stamp + offset <= window.imu().lastStamp());
}

void VisualInertialCalibrator::Impl::advance() {
  while (!images.empty() && coveredByImu(images.front().stamp)) {
    const ImageFrame image = std::move(images.front());
    images.pop_front();
    take(look(image));
  }
  while (!waiting.empty() && coveredByImu(waiting.front().stamp)) {
    VisualKeyframe measured = std::move(waiting.front());
    waiting.pop_front();
    take(std::move(measured));
  }
}

void VisualInertialCalibrator::Impl::take(VisualKeyframe keyframe) {
  const bool few = keyframe.tracks.size() < kFewFeatures && !keyframe.board;
  if (few) ++diagnostics.counts["images with few features"];
  hungry_images = few ? hungry_images + 1 : 0;
  if (hungry_images == kStarving) say();
  const TimeNs offset = toNs(window.state().calibration.camera_time_offset_s);
  if (started) {
    const std::string reason = interruption(window, keyframe.stamp + offset, params.window_s, "pictures");
    if (!reason.empty()) restart(reason);
  }
  if (!started) {
    explored.push_back(std::move(keyframe));
    while (toSeconds(explored.back().stamp - explored.front().stamp) > params.initialization_s) explored.pop_front();
    return;
  }
  window.extendTo(keyframe.stamp + offset);
  window.addFrame(thinTracks(keyframe, params.track_rate_hz));
  unreported.push_back(std::move(keyframe));
  if (isDue(window.state().nodes.back().stamp, last_solve, params.solve_period_s)) solve();
}

bool VisualInertialCalibrator::isTooSoon(TimeNs stamp) const {
  if (!impl_->order.last()) return false;
  const double since = toSeconds(stamp - *impl_->order.last());
  return since > 0.0 && since < kRateSlack / (impl_->effort * impl_->params.frame_rate_hz);
}

void VisualInertialCalibrator::setEffort(double share) { impl_->effort = share; }

CalibrationEstimate VisualInertialCalibrator::estimate() const { return impl_->estimate; }

void VisualInertialCalibrator::setJointCalibration(const Calibration& calibration) {
  Impl& m = *impl_;
  if (!m.started) return;
  if (!isUsable(calibration.T_imu_camera, calibration.camera_time_offset_s)) {
    ++m.diagnostics.counts["feedback refused"];
    return;
  }
  Calibration own = m.window.state().calibration;
  own.T_imu_camera = calibration.T_imu_camera;
  own.camera_time_offset_s = calibration.camera_time_offset_s;
  m.window.setLinearization(own);
}

CalibratorDiagnostics VisualInertialCalibrator::diagnostics() const {
  CalibratorDiagnostics out = impl_->diagnostics;
  out.counts["imu samples dropped"] = impl_->inbox.dropped();
  out.counts["imu samples refused"] = impl_->inbox.refused();
  return out;
}

void VisualInertialCalibrator::reset() {
  Impl& m = *impl_;
  m.window.imu().clear();
  m.tracker.reset();
  m.started = false;
  m.order.reset();
  m.last_tracks.reset();
  m.last_try.reset();
  m.images.clear();
  m.explored.clear();
  m.exploration.forget();
  m.waiting.clear();
  m.unreported.clear();
  m.solved = 0;
  m.last_solve = 0;
  m.failed.reset();
  m.why_anew.clear();
  m.hungry_images = 0;
  m.estimate = CalibrationEstimate();
  m.diagnostics.stage = "waiting for imu";
  m.diagnostics.message = m.estimate.message = "waiting for inertial data and pictures";
}

}  // namespace cocalib
