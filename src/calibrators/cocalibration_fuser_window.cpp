// Start and windows of the CoCalibrationFuser.

#include <algorithm>
#include <deque>
#include <memory>
#include <utility>

#include "cocalib/calibrators/separate_estimates.h"
#include "cocalib/estimation/observability.h"
#include "cocalibration_fuser_impl.h"

namespace cocalib {
namespace {

// The first solve starts from the sub-calibrators' states, centimetres off; each round closes the gates further.
constexpr double kFirstSlacks_m[] = {0.10, 0.03, 0.01};
constexpr int kFirstIterations = 6;
constexpr int kIterations = 2;  // a second: the next one goes on from here
constexpr double kSlack_m = 0.005;

}  // namespace

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

bool CoCalibrationFuser::Impl::start() {
  const std::deque<NavState>& states = hints().states();
  forgetUselessImu(states.front().stamp, states.back().stamp, &window.imu());
  if (window.imu().empty()) return false;
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
  if (!first_stamp) first_stamp = first->stamp;
  started = true;
  interrupted = false;
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

/// @return whether the states explain the data after it
bool CoCalibrationFuser::Impl::solveRound(Relink what, double slack_m, int iterations) {
  window.relink(what, slack_m);
  if (window.optimize(iterations).failed) return false;
  window.learnNoise();
  return explainsData(window);
}

/// Windows, hints and queues as before the start. @param prior  what is known of the calibration all the same
void CoCalibrationFuser::Impl::beginAnew(const std::optional<CalibrationPrior>& prior) {
  window.setCalibrationPrior(prior);
  record.window().setCalibrationPrior(prior);
  record.reset();
  queues.drop();
  visual_hints.clear();
  lidar_hints.clear();
  failed.reset();
  published = nullptr;
  started = false;
}

/// After an interruption: the states cannot be carried over it, the calibration can.
void CoCalibrationFuser::Impl::goOnAfter(const std::string& reason) {
  const std::optional<CalibrationPrior> known = knowledge(estimate);
  ++diagnostics.counts["restarts after interruption"];
  beginAnew(known ? known : params.prior);
  interrupted = known.has_value();
  diagnostics.message = estimate.message = "going on with what is known, after " + reason;
}

/// After failures: what seemed to be known may be what is wrong.
void CoCalibrationFuser::Impl::startOver(const std::string& reason) {
  beginAnew(params.prior);
  judge.reset();
  visual_alone = lidar_alone = CalibrationEstimate();
  first_stamp.reset();
  sayStartingOver(reason, &estimate, &diagnostics);
}

/// Takes in all data up to the horizon. @return whether there is anything new to solve for
bool CoCalibrationFuser::Impl::takeNewData() {
  if (!ready() || (!started && !start())) return false;
  const auto until = horizon();
  if (!until || *until <= window.state().nodes.back().stamp) return false;
  const std::string reason = imuGap(window, *until);
  if (!reason.empty()) {
    goOnAfter(reason);
    return false;
  }
  extend(std::min(*until, window.imu().lastStamp()));
  return true;
}

/// @return false if there is nothing new
bool CoCalibrationFuser::Impl::solveNewData() {
  const bool first = !started;
  if (!takeNewData()) return false;
  bool good = false;
  if (first) {
    for (const double slack : kFirstSlacks_m) good = solveRound(Relink::kNewPlanes, slack, kFirstIterations);
  } else {
    good = solveRound(window.neededRelink(), kSlack_m, kIterations);
  }
  if (failed.note(good, &diagnostics)) {
    startOver("the calibrators' data contradict each other");
    return false;
  }
  return true;
}

/// Hands what is older to the record and turns it into a prior.
void CoCalibrationFuser::Impl::slide(TimeNs oldest) {
  if (window.state().nodes.front().stamp >= oldest) return;
  record.take(window, oldest);
  if (!window.marginalizeBefore(oldest)) ++diagnostics.counts["failed marginalizations"];
}

}  // namespace cocalib
