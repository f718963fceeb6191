#pragma once

#include <optional>
#include <string>

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/calibrators/convergence_judge.h"
#include "cocalib/calibrators/keyframe_queues.h"
#include "cocalib/calibrators/state_hints.h"
#include "cocalib/calibrators/window_estimate.h"
#include "cocalib/calibrators/window_health.h"
#include "cocalib/calibrators/window_record.h"
#include "cocalib/estimation/inertial_window.h"
#include "cocalib/inertial/imu_inbox.h"
#include "fuser_window.h"

namespace cocalib {

/// Intake, start and windows; cocalibration_fuser.cpp and cocalibration_fuser_window.cpp implement it.
struct CoCalibrationFuser::Impl {
  Impl(const FuserParams& p, const ImuNoise& noise, const FuserInputs& in)
      : params(p),
        inputs(in),
        window(fuserWindowParams(p, noise, in)),
        record(fuserWindowParams(p, noise, in), p.window_s),
        judge(in.camera.has_value(), in.lidar) {}

  bool relayUnseen();
  bool ready() const;
  std::optional<TimeNs> horizon() const;
  const StateHints& hints() const { return inputs.lidar ? lidar_hints : visual_hints; }
  void boundQueues();
  void noteSilence(const std::optional<TimeNs>& before, TimeNs now, const std::string& what);
  void remember(const std::optional<NavState>& state, StateHints* hints) const;
  bool start();
  void extend(TimeNs until);
  bool takeNewData();
  bool solveNewData();
  bool solveRound(Relink what, double slack_m, int iterations);
  void beginAnew(const std::optional<CalibrationPrior>& prior);
  void goOnAfter(const std::string& reason);
  void startOver(const std::string& reason);
  void slide(TimeNs oldest);
  void publish(InertialWindow* from);

  FuserParams params;
  FuserInputs inputs;
  InertialWindow window;  // the newest seconds, with a prior for what came before: solved once a second
  WindowRecord record;    // everything, for the last word
  ImuInbox inbox;
  KeyframeQueues queues;
  StateHints visual_hints, lidar_hints;
  CalibrationEstimate visual_alone, lidar_alone, estimate;
  ConvergenceJudge judge;
  const InertialWindow* published = nullptr;  // where the estimate is from
  FailedSolves failed;
  bool started = false;
  bool interrupted = false;  // the estimate stands, the window has to begin anew
  std::optional<TimeNs> first_stamp;
  TimeNs solved_until = 0;
  int keyframes = 0, board_views = 0;
  CalibratorDiagnostics diagnostics;
};

}  // namespace cocalib
