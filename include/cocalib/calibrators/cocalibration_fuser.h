#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>

#include "cocalib/calibrators/diagnostics.h"
#include "cocalib/estimation/calibration_prior.h"
#include "cocalib/estimation/estimate.h"
#include "cocalib/estimation/residual_samples.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"
#include "cocalib/sensors/imu_noise.h"

namespace cocalib {

/// Settings of CoCalibrationFuser.
struct FuserParams {
  double window_s = 90.0;        ///< data kept for the last word, finish(); older data becomes a prior, 10..600
  double live_window_s = 6.0;    ///< data solved for again every time; older data becomes a prior, 5..60
  double first_solve_s = 4.0;    ///< data needed for the first solve, 1..60
  double solve_period_s = 1.0;   ///< data time between two solves, 0.5..60
  double range_noise_m = 0.03;   ///< of the lidar, 1 sigma
  double corner_sigma_px = 0.1;  ///< of a chessboard corner, 1 sigma
  double track_sigma_px = 0.7;   ///< of a natural feature, 1 sigma

  std::optional<CalibrationPrior> prior;  ///< what earlier data have shown; nothing: start from nothing

  /// @throws std::invalid_argument naming every broken bound
  void validate() const;
};

/// Which parts take part: a rig without camera runs the lidar part alone, and so on.
struct FuserInputs {
  std::optional<CameraModel> camera;
  bool lidar = false;
  std::optional<BoardGeometry> board;
};

/// Estimates both mountings and both clock offsets jointly from the keyframes of the two calibrators (paper III-C and
/// III-D, Eq. 7-10), every factor once. Thread rule: addImu() may be called from any thread at any time; all other
/// calls come from one thread, and solve() may take a second. Never throws on data.
class CoCalibrationFuser {
 public:
  CoCalibrationFuser(const FuserParams& params, const ImuNoise& imu_noise, const FuserInputs& inputs);
  ~CoCalibrationFuser();

  void addImu(const ImuSample& sample);
  void addVisual(VisualKeyframe keyframe);
  void addLidar(LidarKeyframe keyframe);
  /// Starting points; newer ones replace older ones until the fuser has solved for the first time. Where the motion
  /// shows nothing of a sensor, so that the fuser cannot start, they become the estimate.
  /// @return whether the estimate changed
  bool setVisualEstimate(const CalibrationEstimate& estimate);
  bool setLidarEstimate(const CalibrationEstimate& estimate);

  /// True when enough new data has come for the next solve (a function of the data alone, so runs repeat).
  bool wantsSolve() const;
  /// One round: association, Gauss-Newton, covariance. Returns whether the estimate changed.
  bool solve();
  /// Last round over all data, to convergence. @param progress called with 0..1; may be empty
  void finish(const std::function<void(double)>& progress = {});

  CalibrationEstimate estimate() const;
  /// Pose of the board in the lidar-world, for display.
  std::optional<Pose> boardPose() const;
  /// IMU state at the newest keyframe.
  std::optional<NavState> latestState() const;
  /// What the present estimate leaves unexplained of the data in the window.
  ResidualSamples residuals() const;

  CalibratorDiagnostics diagnostics() const;
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cocalib
