#include "cocalib/calibrators/separate_estimates.h"

#include <algorithm>

#include "cocalib/estimation/observability.h"

namespace cocalib {
namespace {

/// Biases and gravity are the lidar's.
CalibrationEstimate sideBySide(const CalibrationEstimate& camera, const CalibrationEstimate& lidar) {
  CalibrationEstimate both = lidar;
  both.calibration.T_imu_camera = camera.calibration.T_imu_camera;
  both.calibration.camera_time_offset_s = camera.calibration.camera_time_offset_s;
  both.covariance.setZero();
  both.covariance.block<6, 6>(0, 0) = camera.covariance.block<6, 6>(0, 0);
  both.covariance.block<6, 6>(6, 6) = lidar.covariance.block<6, 6>(6, 6);
  both.covariance(12, 12) = camera.covariance(12, 12);
  both.covariance(13, 13) = lidar.covariance(13, 13);
  both.stamp = std::max(camera.stamp, lidar.stamp);
  both.duration_s = std::max(camera.duration_s, lidar.duration_s);
  both.quality.reprojection_rms_px = camera.quality.reprojection_rms_px;
  both.quality.board_views = camera.quality.board_views;
  judgeEstimate(true, true, ObservabilityThresholds(), &both);
  both.message = isSeen(camera.camera) ? "lidar: " + lidar.message : "camera: " + camera.message;
  return both;
}

}  // namespace

std::optional<CalibrationEstimate> unseenSideBySide(const CalibrationEstimate* camera,
                                                    const CalibrationEstimate* lidar) {
  if ((camera && !camera->camera.valid) || (lidar && !lidar->lidar.valid)) return std::nullopt;
  const bool seen = (!camera || isSeen(camera->camera)) && (!lidar || isSeen(lidar->lidar));
  if (seen) return std::nullopt;
  if (camera && lidar) return sideBySide(*camera, *lidar);
  return camera ? *camera : *lidar;
}

double leverPrior(const SensorVerdict& verdict) {
  constexpr double kGuess_m = 0.1, kAnywhere_m = 1.0;
  if (!verdict.valid || verdict.unobservable.empty()) return kAnywhere_m;
  return std::clamp(verdict.sigma.head<3>().maxCoeff(), kGuess_m, kAnywhere_m);
}

}  // namespace cocalib
