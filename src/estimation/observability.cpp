#include "cocalib/estimation/observability.h"

#include <cmath>
#include <cstdio>

namespace cocalib {
namespace {

constexpr const char* kAxes[] = {"x", "y", "z"};
// A lever arm along an axis shows only when the rig turns about another one.
constexpr const char* kOtherAxes[] = {"y or z", "x or z", "x or y"};

std::string worstAxis(const SensorVerdict& verdict, const char* sensor, const ObservabilityThresholds& thresholds) {
  double worst = 1.0;
  int axis = -1;
  for (int i = 0; i < 6; ++i) {
    const double limit = i < 3 ? thresholds.converged_translation_m : thresholds.converged_rotation_rad;
    if (verdict.sigma[i] / limit <= worst) continue;
    worst = verdict.sigma[i] / limit;
    axis = i;
  }
  if (axis < 0) return {};
  char text[160];
  if (axis < 3) {
    std::snprintf(text, sizeof text, "%s translation along imu %s is known to %.1f mm; turn the rig about %s", sensor,
                  kAxes[axis], 1e3 * verdict.sigma[axis], kOtherAxes[axis]);
  } else {
    std::snprintf(text, sizeof text, "%s rotation about imu %s is known to %.2f deg; turn the rig about %s", sensor,
                  kAxes[axis - 3], verdict.sigma[axis] * 57.29578, kOtherAxes[axis - 3]);
  }
  return text;
}

}  // namespace

SensorVerdict judge(const Matrix6d& covariance, double time_offset_variance, const std::string& frame,
                    const ObservabilityThresholds& thresholds) {
  SensorVerdict verdict;
  verdict.valid = true;
  verdict.sigma = covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  verdict.time_offset_sigma_s = std::sqrt(std::max(0.0, time_offset_variance));
  for (int i = 0; i < 3; ++i) {
    if (verdict.sigma[i] > thresholds.unobservable_translation_m) {
      verdict.unobservable.push_back("translation along " + frame + " " + kAxes[i] + ": rotate about " + kOtherAxes[i]);
    }
  }
  for (int i = 0; i < 3; ++i) {
    if (verdict.sigma[3 + i] > thresholds.unobservable_rotation_rad) {
      verdict.unobservable.push_back("rotation about " + frame + " " + kAxes[i] + ": rotate about " + kOtherAxes[i]);
    }
  }
  return verdict;
}

bool isConverged(const SensorVerdict& verdict, const ObservabilityThresholds& thresholds) {
  return verdict.valid && verdict.unobservable.empty() &&
         verdict.sigma.head<3>().maxCoeff() <= thresholds.converged_translation_m &&
         verdict.sigma.tail<3>().maxCoeff() <= thresholds.converged_rotation_rad &&
         verdict.time_offset_sigma_s <= thresholds.converged_time_offset_s;
}

void judgeEstimate(bool camera, bool lidar, const ObservabilityThresholds& thresholds, CalibrationEstimate* estimate) {
  const Matrix14d& P = estimate->covariance;
  bool converged = true, unobservable = false;
  std::string hint;
  if (camera) {
    estimate->camera = judge(P.block<6, 6>(0, 0), P(12, 12), "imu", thresholds);
    converged = converged && isConverged(estimate->camera, thresholds);
    unobservable = unobservable || !estimate->camera.unobservable.empty();
    hint = worstAxis(estimate->camera, "camera", thresholds);
  }
  if (lidar) {
    estimate->lidar = judge(P.block<6, 6>(6, 6), P(13, 13), "imu", thresholds);
    converged = converged && isConverged(estimate->lidar, thresholds);
    unobservable = unobservable || !estimate->lidar.unobservable.empty();
    if (hint.empty()) hint = worstAxis(estimate->lidar, "lidar", thresholds);
  }
  if (camera && lidar) {
    const double offset_variance = P(12, 12) + P(13, 13) - 2.0 * P(12, 13);
    estimate->lidar_camera =
        judge(lidarCameraCovariance(estimate->calibration, P), offset_variance, "lidar", thresholds);
  }
  estimate->status = unobservable ? Status::kUnobservable : converged ? Status::kConverged : Status::kConverging;
  estimate->message = converged ? "every axis is within its threshold" : hint;
}

}  // namespace cocalib
