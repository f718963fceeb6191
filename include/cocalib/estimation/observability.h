#pragma once

#include <string>
#include <vector>

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
/// y".
SensorVerdict judge(const Matrix6d& covariance, double time_offset_variance, const std::string& frame,
                    const ObservabilityThresholds& thresholds);

/// All axes and the offset are within the thresholds of a converged calibration.
bool isConverged(const SensorVerdict& verdict, const ObservabilityThresholds& thresholds);

/// Fills the verdicts, the status and the message of an estimate from its calibration and covariance.
void judgeEstimate(bool camera, bool lidar, const ObservabilityThresholds& thresholds, CalibrationEstimate* estimate);

}  // namespace cocalib
