#pragma once

#include <deque>
#include <optional>
#include <string>
#include <utility>
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

/// Tells whether an estimate from new data contradicts a calibration. A change must be large as well as certain, so
/// that what a few seconds of data get wrong raises no alarm. Immutable.
class MountingComparison {
 public:
  struct Params {
    double sigmas = 6.0;                ///< of the change, that make it certain
    double least_translation_m = 0.01;  ///< smaller changes are not reported
    double least_rotation_rad = 0.003;
  };

  MountingComparison(const Params& params, const CalibrationEstimate& calibrated)
      : params_(params), calibrated_(calibrated) {}

  /// @param now  from data after the calibration, without using it
  /// @return at most one change a sensor, each with the axis that says it most clearly
  std::vector<MountingChange> compare(const CalibrationEstimate& now) const;
  const CalibrationEstimate& calibrated() const { return calibrated_; }

 private:
  std::optional<MountingChange> compare(const CalibrationEstimate& now, bool camera) const;

  Params params_;
  CalibrationEstimate calibrated_;
};

/// Watches a finished calibration: calibrates short pieces of new data from scratch, one after the other, and compares.
/// The piece in which a sensor moves fits neither place and may blame the other sensor, so a change is reported from
/// the second piece in a row on that shows one; that second look begins at once and ends as soon as it is certain.
/// Not thread-safe.
class MountingWatch {
 public:
  struct Params {
    double piece_s = 6.0;        ///< data of one look
    double second_look_s = 3.0;  ///< data from which on a second look may confirm what the first has shown
    MountingComparison::Params comparison;
  };

  /// @param calibrated  what is watched, with its covariance
  MountingWatch(const Params& params, const FuserParams& fuser_params, const ImuNoise& imu_noise,
                const FuserInputs& inputs, const CalibrationEstimate& calibrated);

  void addImu(const ImuSample& sample);
  void addVisual(VisualKeyframe keyframe) { fuser_->addVisual(std::move(keyframe)); }
  void addLidar(LidarKeyframe keyframe) { fuser_->addLidar(std::move(keyframe)); }

  /// Looks at the newest piece once it is long enough (that takes about a second), and begins the next one.
  std::vector<MountingChange> examine();
  int pieces() const { return pieces_; }

 private:
  /// @param first_look_s  data after which the piece is looked at for the first time
  void beginPiece(double first_look_s);

  const Params params_;
  const FuserParams fuser_params_;
  const ImuNoise imu_noise_;
  const FuserInputs inputs_;
  const MountingComparison comparison_;
  std::optional<CoCalibrationFuser> fuser_;
  std::deque<ImuSample> recent_;  // keyframes come late: the next piece needs samples that are here already
  int pieces_ = 0;
  bool suspicious_ = false;  // the last piece showed a change
};

}  // namespace cocalib
