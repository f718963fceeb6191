#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <vector>

#include "cocalib/calibrators/diagnostics.h"
#include "cocalib/estimation/estimate.h"
#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/imu_noise.h"

namespace cocalib {

/// Settings of LidarInertialCalibrator; defaults suit a 10 Hz spinning lidar carried by hand.
struct LidarInertialParams {
  double range_noise_m = 0.03;     ///< 1 sigma, 0.001..0.5
  double window_s = 5.0;           ///< length of the sliding window, 2..60
  double solve_period_s = 1.0;     ///< data time between two solves, 0.1..10
  double initialization_s = 12.0;  ///< data kept while nothing is known, 3..60
  int max_points = 30000;          ///< points kept of a sweep, spread evenly, 500..200000

  /// @throws std::invalid_argument naming every broken bound
  void validate() const;
};

/// One sweep, deskewed with one version of the calibration.
struct DeskewedCloud {
  TimeNs stamp = 0;  ///< of the instant to which T_W_I refers, IMU clock
  Pose T_W_I;
  TimeNs sweep = 0;                       ///< stamp of the sweep, lidar clock
  std::vector<Eigen::Vector3f> points_W;  ///< same order as the (subsampled) sweep
  std::vector<std::int16_t> plane;        ///< plane number of each point, -1: none
  Calibration calibration;                ///< the one of all its points (lidar part)
  std::uint32_t calibration_version = 0;  ///< grows with every accepted improvement; never changes inside a cloud
};

/// Finds T_imu_lidar and the lidar's clock offset from IMU and sweeps (paper III-B, Eq. 4-6), and rewrites its deskew
/// with what it has learnt. Thread rule: addImu() may be called from any thread at any time; all other calls
/// come from one thread. Never throws on data.
class LidarInertialCalibrator {
 public:
  LidarInertialCalibrator(const LidarInertialParams& params, const ImuNoise& imu_noise,
                          const std::optional<Pose>& guess_T_imu_lidar);
  ~LidarInertialCalibrator();

  void addImu(const ImuSample& sample);

  /// Processes one sweep; sweeps come in order. Returns the keyframes that are complete now, in order (see
  /// VisualInertialCalibrator::addImage()).
  /// @param look  called after every sweep that joins the window, before a solve that may be due: whoever shows
  ///              deskewedCloud() need not wait for it
  std::vector<LidarKeyframe> addScan(LidarScan scan, const std::function<void()>& look = nullptr);

  /// On a machine that is too slow for all points. @param share  of a sweep's that is kept, and of the attempts at a
  /// start that are made, from now on; above 0, to 1
  void setEffort(double share);

  /// Keyframes held back for want of a state, at the end of the data.
  std::vector<LidarKeyframe> flush();

  /// The newest estimate of this sub-calibration alone (lidar part and biases filled).
  CalibrationEstimate estimate() const;

  /// The newest sweep, deskewed with the newest calibration; nothing before the mounting is known.
  std::optional<DeskewedCloud> deskewedCloud() const;
  /// A sparse map of the newest window, deskewed with the newest calibration (world frame).
  std::vector<Eigen::Vector3f> map() const;

  /// Feedback of the joint calibration: changes deskew, prediction and linearisation, never enters as information.
  void setJointCalibration(const Calibration& calibration);

  CalibratorDiagnostics diagnostics() const;
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cocalib
