#include "cocalib/calibrators/visual_inertial_calibrator.h"

#include <algorithm>
#include <deque>

#include "cocalib/calibrators/camera_exploration.h"
#include "cocalib/calibrators/window_start.h"
#include "cocalib/estimation/inertial_window.h"
#include "cocalib/estimation/observability.h"
#include "cocalib/inertial/imu_inbox.h"
#include "cocalib/visual/board_detector.h"
#include "cocalib/visual/feature_tracker.h"

namespace cocalib {
namespace {

constexpr double kFirstTry_s = 3.0;  // of pictures, before the first attempt at a mounting
constexpr double kTryPeriod_s = 1.0;
constexpr double kGuessShare = 0.8;  // of initialization_s without success, before the guess stands in
// A search costs as much as twenty tracked pictures; once the window predicts the board there is nothing left to
// search.
constexpr double kSearchPeriod_s = 0.8;
constexpr int kStartRounds = 3;
constexpr int kStartIterations = 8;
constexpr int kIterations = 3;
constexpr int kMaxBadSolves = 3;        // in a row, before it starts over
constexpr double kMinConsistent = 0.5;  // share of the observations that the states explain
constexpr std::size_t kFewFeatures = 20;
constexpr int kStarving = 10;  // pictures in a row with few features, before it says so
constexpr double kRateSlack = 0.9;  // a picture counts as due a little before its time, so that jitter skips none

}  // namespace

struct VisualInertialCalibrator::Impl {
  Impl(const VisualInertialParams& p, const ImuNoise& noise, const CameraModel& model,
       const std::optional<BoardGeometry>& b, const std::optional<Pose>& g)
      : params(p),
        guess(g),
        camera(model),
        board(b),
        tracker(model, FeatureTracker::Params()),
        window(windowParams(noise, model, b)) {
    if (board) {
      BoardDetector::Params detection;
      detection.search_period_s = kSearchPeriod_s;
      detector.emplace(*board, camera, detection);
    }
  }
  static InertialWindow::Params windowParams(const ImuNoise& noise, const CameraModel& model,
                                             const std::optional<BoardGeometry>& board) {
    InertialWindow::Params out;
    out.imu_noise = noise;
    out.camera.emplace(model);
    out.camera->board = board;
    return out;
  }

  bool comesInOrder(TimeNs stamp) const { return !last_image || stamp > *last_image; }
  std::vector<VisualKeyframe> keyframesAfterAdvance();
  VisualKeyframe look(const ImageFrame& image);
  std::optional<Eigen::Quaterniond> predictRotation(TimeNs stamp) const;
  void predictBoard(TimeNs stamp);
  bool tryToStart();
  void startWindow(const Alignment& alignment);
  bool coveredByImu(TimeNs stamp) const;
  void advance();
  void take(VisualKeyframe keyframe);
  void solve();
  bool solveWindow();
  void restart(const std::string& reason);
  void publish();
  void say();
  std::vector<VisualKeyframe> takeKeyframes();

  VisualInertialParams params;
  std::optional<Pose> guess;
  CameraModel camera;
  std::optional<BoardGeometry> board;
  std::optional<BoardDetector> detector;
  FeatureTracker tracker;
  InertialWindow window;
  ImuInbox inbox;
  bool started = false;
  std::optional<TimeNs> last_image, last_tracks;
  std::deque<ImageFrame> images;        // that wait for inertial data,
  std::deque<VisualKeyframe> explored;  // before the start, newest initialization_s
  std::optional<TimeNs> last_try;
  std::deque<VisualKeyframe> waiting;  // and measurements that do
  std::deque<VisualKeyframe> unreported;
  TimeNs last_solve = 0;
  int bad_solves = 0, hungry_images = 0;  // in a row
  CalibrationEstimate estimate;
  CalibratorDiagnostics diagnostics;
};

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
  if (!m.comesInOrder(image.stamp)) {
    ++m.diagnostics.counts["images out of order"];
    if (image.stamp < *m.last_image - toNs(1.0)) reset();
    return {};
  }
  if (m.last_image && toSeconds(image.stamp - *m.last_image) < kRateSlack / m.params.frame_rate_hz) return {};
  if (image.gray.cols != m.camera.width() || image.gray.rows != m.camera.height()) {
    ++m.diagnostics.counts["images of the wrong size"];
    return {};
  }
  m.last_image = image.stamp;
  m.images.push_back(image);
  return m.keyframesAfterAdvance();
}

std::vector<VisualKeyframe> VisualInertialCalibrator::addMeasurements(VisualKeyframe measured) {
  Impl& m = *impl_;
  if (!m.inbox.drainTo(&m.window.imu())) reset();
  if (!m.comesInOrder(measured.stamp)) {
    ++m.diagnostics.counts["images out of order"];
    return {};
  }
  m.last_image = measured.stamp;
  m.waiting.push_back(std::move(measured));
  return m.keyframesAfterAdvance();
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
  const bool few = keyframe.tracks.size() < kFewFeatures;
  if (few) ++diagnostics.counts["images with few features"];
  hungry_images = few ? hungry_images + 1 : 0;
  if (hungry_images == kStarving) say();
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
  const TimeNs offset = toNs(window.state().calibration.camera_time_offset_s);
  if (started && toSeconds(keyframe.stamp + offset - window.state().nodes.back().stamp) > params.window_s) {
    restart("no pictures for longer than the window");
  }
  if (!started) {
    explored.push_back(std::move(keyframe));
    while (toSeconds(explored.back().stamp - explored.front().stamp) > params.initialization_s) explored.pop_front();
    return;
  }
  window.extendTo(keyframe.stamp + offset);
  window.addFrame(thinTracks(keyframe, params.track_rate_hz));
  unreported.push_back(std::move(keyframe));
  if (toSeconds(window.state().nodes.back().stamp - last_solve) >= params.solve_period_s) solve();
}

bool VisualInertialCalibrator::Impl::tryToStart() {
  if (explored.empty()) return false;
  const TimeNs now = explored.back().stamp;
  if (toSeconds(now - explored.front().stamp) < kFirstTry_s) return false;
  if (last_try && toSeconds(now - *last_try) < kTryPeriod_s) return false;
  last_try = now;
  std::string reason;
  const CameraExploration exploration(camera, board);
  const std::vector<VisualKeyframe> frames(explored.begin(), explored.end());
  auto alignment = exploration.align(window.imu(), frames, std::nullopt, &reason);
  if (!alignment && guess && toSeconds(now - frames.front().stamp) >= kGuessShare * params.initialization_s) {
    std::string doubt;
    alignment = exploration.align(window.imu(), frames, guess, &doubt);
    if (!alignment) reason += " (nor does it start from the initial guess: " + doubt + ")";
  }
  if (!alignment) {
    diagnostics.stage = "waiting for motion";
    diagnostics.message = estimate.message = reason;
    return false;
  }
  startWindow(*alignment);
  return true;
}

void VisualInertialCalibrator::Impl::startWindow(const Alignment& alignment) {
  Calibration calibration;
  calibration.T_imu_camera = alignment.T_imu_sensor;
  calibration.camera_time_offset_s = alignment.time_offset_s;
  startNodes(alignment, calibration, &window);
  const TimeNs offset = toNs(alignment.time_offset_s);
  const TimeNs first = window.state().nodes.front().stamp, last = window.state().nodes.back().stamp;
  for (VisualKeyframe& keyframe : explored) {
    const TimeNs stamp = keyframe.stamp + offset;
    if (stamp < first) continue;
    if (stamp > last) window.extendTo(stamp);
    window.addFrame(thinTracks(keyframe, params.track_rate_hz));
    unreported.push_back(std::move(keyframe));
  }
  explored.clear();
  for (int round = 0; round < kStartRounds; ++round) {
    window.relink(false, 0.0);
    window.optimize(kStartIterations);
    window.learnNoise();
  }
  started = true;
  last_solve = window.state().nodes.back().stamp;
  diagnostics.stage = "refining";
  publish();
}

/// Whether the states explain the pictures after it.
bool VisualInertialCalibrator::Impl::solveWindow() {
  window.relink(false, 0.0);
  if (window.optimize(kIterations).failed) return false;
  window.learnNoise();
  return window.camera()->consistentShare() >= kMinConsistent;
}

void VisualInertialCalibrator::Impl::solve() {
  last_solve = window.state().nodes.back().stamp;
  if (solveWindow()) {
    bad_solves = 0;
  } else {
    ++diagnostics.counts["failed solves"];
    if (++bad_solves >= kMaxBadSolves) return restart("the pictures contradict the inertial data");
  }
  const TimeNs oldest = last_solve - toNs(params.window_s);
  if (window.state().nodes.front().stamp < oldest && !window.marginalizeBefore(oldest)) {
    ++diagnostics.counts["failed marginalizations"];
  }
  publish();
}

/// Looks for the mounting anew, as if nothing were known.
void VisualInertialCalibrator::Impl::restart(const std::string& reason) {
  ++diagnostics.counts["restarts after failure"];
  started = false;
  bad_solves = 0;
  last_try.reset();
  explored.clear();
  unreported.clear();
  estimate = CalibrationEstimate();
  diagnostics.stage = "starting over";
  diagnostics.message = estimate.message = "starting over: " + reason;
}

void VisualInertialCalibrator::Impl::publish() {
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
  const CameraGroup& group = *window.camera();
  estimate.quality.board_views = group.boardViews();
  estimate.quality.reprojection_rms_px = group.sawBoard() ? group.cornerRms() : group.trackRms();
  estimate.quality.keyframes = static_cast<int>(state.nodes.size());
  judgeEstimate(true, false, ObservabilityThresholds(), &estimate);
  say();
}

/// The estimate's words, unless the pictures are the trouble.
void VisualInertialCalibrator::Impl::say() {
  diagnostics.message = hungry_images < kStarving
                            ? estimate.message
                            : "the pictures show too few features to follow: more light or more texture is needed";
}

std::vector<VisualKeyframe> VisualInertialCalibrator::Impl::takeKeyframes() {
  std::vector<VisualKeyframe> keyframes;
  const WindowState& state = window.state();
  const TimeNs offset = toNs(state.calibration.camera_time_offset_s);
  while (!unreported.empty() && unreported.front().stamp + offset <= last_solve) {
    VisualKeyframe keyframe = thinTracks(unreported.front(), params.track_rate_hz);
    const int node = nodeAt(state.nodes, keyframe.stamp + offset);
    keyframe.state = state.nodes[static_cast<std::size_t>(node)];
    keyframes.push_back(std::move(keyframe));
    unreported.pop_front();
  }
  return keyframes;
}

CalibrationEstimate VisualInertialCalibrator::estimate() const { return impl_->estimate; }

void VisualInertialCalibrator::setJointCalibration(const Calibration& calibration) {
  Impl& m = *impl_;
  if (!m.started) return;
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
  m.last_image.reset();
  m.last_tracks.reset();
  m.last_try.reset();
  m.images.clear();
  m.explored.clear();
  m.waiting.clear();
  m.unreported.clear();
  m.last_solve = 0;
  m.bad_solves = m.hungry_images = 0;
  m.estimate = CalibrationEstimate();
  m.diagnostics.stage = "waiting for imu";
  m.diagnostics.message = m.estimate.message = "waiting for inertial data and pictures";
}

}  // namespace cocalib
