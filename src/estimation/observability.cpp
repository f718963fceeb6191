#include "cocalib/estimation/observability.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace cocalib {
namespace {

constexpr const char* kAxes[] = {"x", "y", "z"};
// A lever arm along an axis shows only when the rig turns about another one.
constexpr const char* kOtherAxes[] = {"y or z", "x or z", "x or y"};

// What a sensor's place and orientation may be before anything is known: anywhere on the rig, turned in any way (1
// sigma of an angle that is even over the circle). A guess is good to a hand's breadth and some degrees.
constexpr double kUnknownPlace_m = 1.0, kUnknownTurn_rad = 1.81;
constexpr double kGuessedPlace_m = 0.1, kGuessedTurn_rad = 0.2;
constexpr double kUnknownOffset_s = 0.1;

/// Axes that a direction which is not determined has a part in.
std::array<bool, 3> openAxes(const Eigen::Matrix3d& covariance, double limit) {
  constexpr double kPart = 0.25;  // of the direction, along the axis: 15 degrees
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(covariance);
  std::array<bool, 3> open{};
  for (int i = 0; i < 3; ++i) open[static_cast<std::size_t>(i)] = covariance(i, i) > limit * limit;
  for (int k = 0; k < 3; ++k) {
    if (eigen.eigenvalues()[k] <= limit * limit) continue;
    for (int i = 0; i < 3; ++i) {
      if (std::abs(eigen.eigenvectors()(i, k)) > kPart) open[static_cast<std::size_t>(i)] = true;
    }
  }
  return open;
}

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
  const auto open_places = openAxes(covariance.topLeftCorner<3, 3>(), thresholds.unobservable_translation_m);
  const auto open_turns = openAxes(covariance.bottomRightCorner<3, 3>(), thresholds.unobservable_rotation_rad);
  for (std::size_t i = 0; i < 3; ++i) {
    if (!open_places[i]) continue;
    verdict.unobservable.push_back("translation along " + frame + " " + kAxes[i] + ": rotate about " + kOtherAxes[i]);
  }
  for (std::size_t i = 0; i < 3; ++i) {
    if (!open_turns[i]) continue;
    verdict.unobservable.push_back("rotation about " + frame + " " + kAxes[i] + ": rotate about " + kOtherAxes[i] +
                                   ", or shift across it, speeding up and slowing down");
  }
  return verdict;
}

bool isSeen(const SensorVerdict& verdict) { return verdict.valid && verdict.unobservable.size() < 6; }

bool isConverged(const SensorVerdict& verdict, const ObservabilityThresholds& thresholds) {
  return verdict.valid && verdict.unobservable.empty() &&
         verdict.sigma.head<3>().maxCoeff() <= thresholds.converged_translation_m &&
         verdict.sigma.tail<3>().maxCoeff() <= thresholds.converged_rotation_rad &&
         verdict.time_offset_sigma_s <= thresholds.converged_time_offset_s;
}

void judgeEstimate(bool camera, bool lidar, const ObservabilityThresholds& thresholds, CalibrationEstimate* estimate,
                   bool camera_scale_unseen) {
  const Matrix14d& P = estimate->covariance;
  bool converged = true, unobservable = false;
  std::string hint;
  if (camera) {
    estimate->camera = judge(P.block<6, 6>(0, 0), P(12, 12), "imu", thresholds);
    for (std::string& flag : estimate->camera.unobservable) {
      if (camera_scale_unseen) flag = flag.substr(0, flag.find(':')) + ": shift the rig, speeding up and slowing down";
    }
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

CalibrationEstimate unseenEstimate(Sensor sensor, const std::optional<Pose>& guess_T_imu_sensor) {
  const bool camera = sensor == Sensor::kCamera;
  const double place = guess_T_imu_sensor ? kGuessedPlace_m : kUnknownPlace_m;
  const double turn = guess_T_imu_sensor ? kGuessedTurn_rad : kUnknownTurn_rad;
  CalibrationEstimate estimate;
  (camera ? estimate.calibration.T_imu_camera : estimate.calibration.T_imu_lidar) = guess_T_imu_sensor.value_or(Pose());
  const int block = camera ? 0 : 6, offset = camera ? 12 : 13;
  estimate.covariance.diagonal().segment<3>(block).setConstant(place * place);
  estimate.covariance.diagonal().segment<3>(block + 3).setConstant(turn * turn);
  estimate.covariance(offset, offset) = kUnknownOffset_s * kUnknownOffset_s;
  judgeEstimate(camera, !camera, ObservabilityThresholds(), &estimate);
  return estimate;
}

}  // namespace cocalib
