#pragma once

#include <optional>
#include <string>

#include "cocalib/estimation/estimate.h"

namespace cocalib {

/// When an axis counts as seen, and when as calibrated; 1 sigma.
struct ObservabilityThresholds {
  double unobservable_translation_m = 0.05;
  double unobservable_rotation_rad = 0.02;
  double converged_translation_m = 0.003;
  double converged_rotation_rad = 0.001;
  double converged_time_offset_s = 0.0005;
};

/// Sigmas of one sensor from its 6x6 covariance (in the IMU frame) and the variance of its clock offset, and in words
/// every axis that the data does not determine, with the motion that would: "translation along imu z: rotate about x or
/// y". A direction that is not determined and lies oblique to the axes counts against each axis that it has a part in.
SensorVerdict judge(const Matrix6d& covariance, double time_offset_variance, const std::string& frame,
                    const ObservabilityThresholds& thresholds);

/// The data has shown some of the mounting: there is an estimate, and not every axis of it is open.
bool isSeen(const SensorVerdict& verdict);

/// All axes and the offset are within the thresholds of a converged calibration.
bool isConverged(const SensorVerdict& verdict, const ObservabilityThresholds& thresholds);

/// Fills the verdicts, the status and the message of an estimate from its calibration and covariance.
/// @param camera_scale_unseen  what is open of the camera's lever arm shows when the rig is shifted, not when it turns
void judgeEstimate(bool camera, bool lidar, const ObservabilityThresholds& thresholds, CalibrationEstimate* estimate,
                   bool camera_scale_unseen = false);

enum class Sensor { kCamera, kLidar };

/// The estimate of one sensor about whose mounting the data shows nothing: the guess with a guess's sigma, or, without
/// one, no shift and no turn with sigmas that leave every mounting possible. Every axis is flagged.
CalibrationEstimate unseenEstimate(Sensor sensor, const std::optional<Pose>& guess_T_imu_sensor);

}  // namespace cocalib
