#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "cocalib/calibrators/diagnostics.h"
#include "cocalib/estimation/estimate.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"
#include "cocalib/sensors/imu_noise.h"

namespace cocalib {

/// Settings of VisualInertialCalibrator; defaults suit a hand-held rig with a 20-50 Hz camera.
struct VisualInertialParams {
  double frame_rate_hz = 20.0;     ///< pictures processed per second at most, 5..100; more than 20 add little
  double track_rate_hz = 8.0;      ///< pictures per second whose natural features enter the window, 1..frame_rate
  double window_s = 6.0;           ///< length of the sliding window, 2..60
  double solve_period_s = 1.0;     ///< data time between two solves, 0.1..10
  double initialization_s = 10.0;  ///< data kept while nothing is known, 3..60

  /// @throws std::invalid_argument naming every broken bound
  void validate() const;
};

/// Finds T_imu_camera and the camera's clock offset from IMU and pictures (paper III-A, Eq. 1-3): front end,
/// start from nothing, sliding window. Thread rule: addImu() may be called from any thread at any time; all other calls
/// come from one thread. Never throws on data.
class VisualInertialCalibrator {
 public:
  VisualInertialCalibrator(const VisualInertialParams& params, const ImuNoise& imu_noise, const CameraModel& camera,
                           const std::optional<BoardGeometry>& board, const std::optional<Pose>& guess_T_imu_camera);
  ~VisualInertialCalibrator();

  void addImu(const ImuSample& sample);

  /// Processes one picture; pictures must come in order. IMU samples up to the picture's time should have come before;
  /// where they have not, the picture waits inside until they have. Returns the keyframes that are complete now
  /// (their state is known, or will never be), in order.
  std::vector<VisualKeyframe> addImage(const ImageFrame& image);

  /// The same for a picture whose corners and tracks were measured elsewhere (recorded keyframes, a simulation).
  std::vector<VisualKeyframe> addMeasurements(VisualKeyframe measured);

  /// Whether a picture of this time follows the last one too soon to be processed: its decoding can be saved.
  bool isTooSoon(TimeNs stamp) const;

  /// On a machine that is too slow for all pictures. @param share  of frame_rate_hz that is processed, and of the
  /// attempts at a start that are made, from now on; above 0, to 1
  void setEffort(double share);

  /// Keyframes held back for want of a state, at the end of the data.
  std::vector<VisualKeyframe> flush();

  /// The newest estimate of this sub-calibration alone (camera part and biases filled).
  CalibrationEstimate estimate() const;

  /// Feedback of the joint calibration: changes prediction and linearisation, never enters as information.
  void setJointCalibration(const Calibration& calibration);

  CalibratorDiagnostics diagnostics() const;
  void reset();

 private:
  bool takesStamp(TimeNs stamp);

  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cocalib
