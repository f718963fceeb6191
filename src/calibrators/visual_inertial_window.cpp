// Start and window of the VisualInertialCalibrator.

#include <utility>

#include "cocalib/calibrators/window_estimate.h"
#include "cocalib/calibrators/window_health.h"
#include "cocalib/calibrators/window_start.h"
#include "cocalib/estimation/observability.h"
#include "visual_inertial_impl.h"

namespace cocalib {
namespace {

constexpr double kFirstTry_s = 3.0;  // of pictures, before the first attempt at a mounting
constexpr double kTryPeriod_s = 1.0;
constexpr double kOpenShare = 0.8;  // of initialization_s without success, before a part may stay open
constexpr int kStartRounds = 3;
constexpr int kStartIterations = 8;
constexpr int kIterations = 2;  // a second: the next one goes on from here

}  // namespace

/// Pictures from before the inertial data, or before a gap in them, can show nothing of the mounting.
void VisualInertialCalibrator::Impl::forgetUselessPictures() {
  if (explored.empty()) return;
  const TimeNs first = forgetUselessImu(explored.front().stamp, explored.back().stamp, &window.imu());
  while (!explored.empty() && explored.front().stamp < first) explored.pop_front();
}

bool VisualInertialCalibrator::Impl::tryToStart() {
  forgetUselessPictures();
  if (explored.empty()) return false;
  const TimeNs now = explored.back().stamp;
  if (toSeconds(now - explored.front().stamp) < kFirstTry_s) return false;
  if (last_try && toSeconds(now - *last_try) < kTryPeriod_s / effort) return false;
  last_try = now;
  std::string reason;
  const std::vector<VisualKeyframe> frames(explored.begin(), explored.end());
  auto alignment = exploration.align(window.imu(), frames, &reason);
  if (!alignment && toSeconds(now - frames.front().stamp) >= kOpenShare * params.initialization_s) {
    alignment = exploration.alignOpenly(window.imu(), frames, guess, &reason);
    const bool imu_there = !window.imu().empty() && window.imu().firstStamp() <= now;
    if (!alignment && imu_there && exploration.seesEnough(frames)) {
      estimate = unseenEstimate(Sensor::kCamera, guess);
      estimate.stamp = now;
      estimate.duration_s = toSeconds(now - frames.front().stamp);
    }
  }
  if (!alignment) {
    diagnostics.stage = "waiting for motion";
    diagnostics.message = estimate.message = why_anew.empty() ? reason : why_anew + "; " + reason;
    return false;
  }
  returnUnseenToPrior(window.imu(), &*alignment);
  startWindow(*alignment);
  return started;
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
    window.relink(Relink::kNewScans, 0.0);
    window.optimize(kStartIterations);
    window.learnNoise();
  }
  started = true;
  last_solve = window.state().nodes.back().stamp;
  solved = unreported.size();
  if (!isPossible(window.state())) return restart("the pictures contradict the inertial data");
  why_anew.clear();
  diagnostics.stage = "refining";
  publish();
}

/// Whether the states explain the pictures after it.
bool VisualInertialCalibrator::Impl::solveWindow() {
  window.relink(Relink::kNewScans, 0.0);
  if (window.optimize(kIterations).failed) return false;
  window.learnNoise();
  return explainsData(window);
}

void VisualInertialCalibrator::Impl::solve() {
  last_solve = window.state().nodes.back().stamp;
  solved = unreported.size();
  if (failed.note(solveWindow(), &diagnostics)) return restart("the pictures contradict the inertial data");
  publish();  // first: the covariance is that of the solve, which marginalizing forgets
  const TimeNs oldest = last_solve - toNs(params.window_s);
  if (!window.marginalizeBefore(oldest)) ++diagnostics.counts["failed marginalizations"];
}

/// Looks for the mounting anew, as if nothing were known.
void VisualInertialCalibrator::Impl::restart(const std::string& reason) {
  started = false;
  failed.reset();
  last_try.reset();
  explored.clear();
  exploration.forget();
  unreported.clear();
  solved = 0;
  sayStartingOver(reason, &estimate, &diagnostics);
  why_anew = estimate.message;
}

void VisualInertialCalibrator::Impl::publish() {
  if (!readEstimate(&window, &estimate)) {
    ++diagnostics.counts["covariances refused"];
    return;
  }
  const CameraGroup& group = *window.camera();
  estimate.quality.board_views = group.boardViews();
  estimate.quality.reprojection_rms_px = group.sawBoard() ? group.cornerRms() : group.trackRms();
  estimate.quality.keyframes = static_cast<int>(window.state().nodes.size());
  judgeEstimate(true, false, ObservabilityThresholds(), &estimate, window.cameraScaleUnseen());
  say();
}

/// The estimate's words, unless the pictures are the trouble.
void VisualInertialCalibrator::Impl::say() {
  diagnostics.message = starving()
                            ? "the pictures show too few features to follow: more light or more texture is needed"
                            : estimate.message;
}

std::vector<VisualKeyframe> VisualInertialCalibrator::Impl::takeKeyframes() {
  std::vector<VisualKeyframe> keyframes;
  const WindowState& state = window.state();
  const TimeNs offset = toNs(state.calibration.camera_time_offset_s);
  for (; solved > 0; --solved) {
    VisualKeyframe keyframe = thinTracks(unreported.front(), params.track_rate_hz);
    const int node = nodeAt(state.nodes, keyframe.stamp + offset);
    keyframe.state = state.nodes[static_cast<std::size_t>(node)];
    keyframes.push_back(std::move(keyframe));
    unreported.pop_front();
  }
  return keyframes;
}

}  // namespace cocalib
