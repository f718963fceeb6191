#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/calibrators/violations.h"
#include "cocalib/calibrators/visual_inertial_calibrator.h"

namespace cocalib {

void VisualInertialParams::validate() const {
  Violations violations("visual-inertial calibrator");
  violations.requireWithin("frame_rate_hz", frame_rate_hz, 5.0, 100.0);
  violations.requireWithin("track_rate_hz", track_rate_hz, 1.0, frame_rate_hz);
  violations.requireWithin("window_s", window_s, 2.0, 60.0);
  violations.requireWithin("solve_period_s", solve_period_s, 0.1, 10.0);
  violations.requireWithin("initialization_s", initialization_s, 3.0, 60.0);
  violations.throwIfAny();
}

void LidarInertialParams::validate() const {
  Violations violations("lidar-inertial calibrator");
  violations.requireWithin("range_noise_m", range_noise_m, 0.001, 0.5);
  violations.requireWithin("window_s", window_s, 2.0, 60.0);
  violations.requireWithin("solve_period_s", solve_period_s, 0.1, 10.0);
  violations.requireWithin("initialization_s", initialization_s, 3.0, 60.0);
  violations.requireWithin("max_points", max_points, 500, 200000);
  violations.throwIfAny();
}

void FuserParams::validate() const {
  Violations violations("co-calibration fuser");
  violations.requireWithin("window_s", window_s, 10.0, 600.0);
  violations.requireWithin("live_window_s", live_window_s, 5.0, 60.0);
  violations.requireWithin("first_solve_s", first_solve_s, 1.0, 60.0);
  violations.requireWithin("solve_period_s", solve_period_s, 0.5, 60.0);
  violations.requireWithin("range_noise_m", range_noise_m, 0.001, 0.5);
  violations.requireWithin("corner_sigma_px", corner_sigma_px, 0.01, 5.0);
  violations.requireWithin("track_sigma_px", track_sigma_px, 0.05, 10.0);
  violations.throwIfAny();
}

}  // namespace cocalib
