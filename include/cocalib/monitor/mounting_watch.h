#pragma once

#include <deque>
#include <string>
#include <vector>

#include "cocalib/calibrators/cocalibration_fuser.h"

namespace cocalib {

/// A sensor that no longer stands where it was calibrated.
struct MountingChange {
  std::string sensor;                  ///< "camera" | "lidar"
  Vector6d change = Vector6d::Zero();  ///< of T_imu_sensor: translation [m], rotation [rad], IMU frame
  Vector6d sigma = Vector6d::Zero();   ///< of the change, 1 sigma
  TimeNs since = 0;                    ///< first data that shows it, IMU clock
  std::string words;                   ///< "camera has turned 0.50 deg about imu y since 12:03:20"
};

/// Watches a finished calibration: calibrates short pieces of new data from scratch, one after the other, and compares.
/// A change must be large as well as certain, so that what a piece of a few seconds gets wrong raises no alarm. Thread
/// rule as for CoCalibrationFuser.
class MountingWatch {
 public:
  struct Params {
    double piece_s = 6.0;               ///< data of one look; three of them pass at most until a change is reported
    double sigmas = 6.0;                ///< of the change, that make it certain
    double least_translation_m = 0.01;  ///< smaller changes are not reported
    double least_rotation_rad = 0.003;
  };

  /// @param calibrated  what is watched, with its covariance
  MountingWatch(const Params& params, const FuserParams& fuser_params, const ImuNoise& imu_noise,
                const FuserInputs& inputs, const CalibrationEstimate& calibrated);

  void addImu(const ImuSample& sample);
  void addVisual(VisualKeyframe keyframe) { fuser_.addVisual(std::move(keyframe)); }
  void addLidar(LidarKeyframe keyframe) { fuser_.addLidar(std::move(keyframe)); }

  /// Looks at the newest piece once it is complete (that takes about a second), and begins the next one. A change is
  /// reported from the second piece in a row on that shows one: the piece in which a sensor moves fits neither place,
  /// and may blame the other sensor.
  std::vector<MountingChange> examine();
  int pieces() const { return pieces_; }

 private:
  void beginPiece();
  void compare(const CalibrationEstimate& now, bool camera, std::vector<MountingChange>* changes) const;

  const Params params_;
  const CalibrationEstimate calibrated_;
  CoCalibrationFuser fuser_;
  std::deque<ImuSample> recent_;  // keyframes come late: the next piece needs samples that are here already
  int pieces_ = 0;
  bool suspicious_ = false;  // the last piece showed a change
};

}  // namespace cocalib
