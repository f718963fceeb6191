#include "cocalib/initialization/rotation_search.h"

#include <Eigen/SVD>
#include <cmath>
#include <limits>

#include "cocalib/geometry/so3.h"
#include "cocalib/initialization/robust.h"

namespace cocalib {
namespace {

constexpr double kOffsetStep_s = 0.005;  // hand and vehicle motion has little above 5 Hz: well inside one valley
constexpr int kReweightings = 5;
constexpr double kCauchySigmas = 2.5;  // beyond this many sigmas a residual counts less than a seventh
constexpr double kSmallestScale_rad = 1e-5;

/// Sensor side of the pairs: mean rates and durations, the same for every offset.
struct SensorRates {
  std::vector<Eigen::Vector3d> rates;
  std::vector<double> durations_s;
};

SensorRates sensorRates(const std::vector<RelativeSensorRotation>& rotations) {
  SensorRates result;
  for (const RelativeSensorRotation& pair : rotations) {
    const double duration = toSeconds(pair.stamp_b - pair.stamp_a);
    result.durations_s.push_back(duration);
    result.rates.push_back(logSo3(pair.R_a_b.normalized()) / duration);
  }
  return result;
}

/// Weights from the residuals' lengths [rad], scale by their median; dimension as in kMedianLength*.
std::vector<double> cauchyWeights(const std::vector<double>& residuals, double median_length) {
  const double sigma = std::max(medianOf(residuals) / median_length, kSmallestScale_rad);
  std::vector<double> weights(residuals.size());
  for (std::size_t i = 0; i < residuals.size(); ++i) weights[i] = cauchyWeight(residuals[i], kCauchySigmas * sigma);
  return weights;
}

/// Centred Wahba problem (Kabsch): w_imu = R w_sensor + bias, closed form.
void fitRotation(const std::vector<Eigen::Vector3d>& imu, const SensorRates& sensor, const std::vector<double>& weights,
                 Eigen::Matrix3d& R, Eigen::Vector3d& bias) {
  double sum = 0.0;
  Eigen::Vector3d mean_imu = Eigen::Vector3d::Zero(), mean_sensor = Eigen::Vector3d::Zero();
  Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < imu.size(); ++i) {
    // A pair's error is an angle, so that its rate is better the longer it lasts.
    const double weight = weights[i] * sensor.durations_s[i] * sensor.durations_s[i];
    sum += weight;
    mean_imu += weight * imu[i];
    mean_sensor += weight * sensor.rates[i];
    moment += weight * imu[i] * sensor.rates[i].transpose();
  }
  mean_imu /= sum;
  mean_sensor /= sum;
  moment -= sum * mean_imu * mean_sensor.transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(moment, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs(1.0, 1.0, (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0);
  R = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  bias = mean_imu - R * mean_sensor;
}

RotationCandidate candidateAt(const InertialPath& gyro, const std::vector<RelativeSensorRotation>& rotations,
                              const SensorRates& sensor, double offset_s) {
  const std::vector<Eigen::Vector3d> imu = meanGyroRates(gyro, rotations, offset_s);
  std::vector<double> residuals(imu.size());
  // Lengths of the rates need no rotation: gross outliers lose their weight before the first fit.
  for (std::size_t i = 0; i < imu.size(); ++i) {
    residuals[i] = std::abs(imu[i].norm() - sensor.rates[i].norm()) * sensor.durations_s[i];
  }
  std::vector<double> weights = cauchyWeights(residuals, kMedianLength1);
  Eigen::Matrix3d R;
  Eigen::Vector3d bias;
  for (int iteration = 0; iteration < kReweightings; ++iteration) {
    fitRotation(imu, sensor, weights, R, bias);
    for (std::size_t i = 0; i < imu.size(); ++i) {
      residuals[i] = (imu[i] - R * sensor.rates[i] - bias).norm() * sensor.durations_s[i];
    }
    weights = cauchyWeights(residuals, kMedianLength3);
  }
  return {offset_s, Eigen::Quaterniond(R), bias, medianOf(residuals)};
}

}  // namespace

std::vector<Eigen::Vector3d> meanGyroRates(const InertialPath& gyro,
                                           const std::vector<RelativeSensorRotation>& rotations, double offset_s) {
  std::vector<Eigen::Vector3d> rates;
  rates.reserve(rotations.size());
  const TimeNs offset = toNs(offset_s);
  for (const RelativeSensorRotation& pair : rotations) {
    const Eigen::Quaterniond R_a_b =
        gyro.rotationAt(pair.stamp_a + offset).conjugate() * gyro.rotationAt(pair.stamp_b + offset);
    rates.push_back(logSo3(R_a_b) / toSeconds(pair.stamp_b - pair.stamp_a));
  }
  return rates;
}

RotationSearch searchRotation(const InertialPath& gyro, const std::vector<RelativeSensorRotation>& rotations,
                              double max_time_offset_s) {
  const SensorRates sensor = sensorRates(rotations);
  const int steps = static_cast<int>(std::ceil(max_time_offset_s / kOffsetStep_s));
  std::vector<RotationCandidate> candidates;
  for (int i = -steps; i <= steps; ++i) candidates.push_back(candidateAt(gyro, rotations, sensor, i * kOffsetStep_s));

  std::size_t best = 0;
  for (std::size_t i = 1; i < candidates.size(); ++i) {
    if (candidates[i].residual_rad < candidates[best].residual_rad) best = i;
  }
  RotationSearch result{candidates[best], std::nullopt};
  // Other valleys: going away from the best offset, wherever the residual has fallen clearly below a ridge it climbed.
  constexpr double kClearDescent = 0.93;
  for (const int direction : {-1, 1}) {
    double ridge = candidates[best].residual_rad;
    for (int i = static_cast<int>(best); i >= 0 && i < static_cast<int>(candidates.size()); i += direction) {
      const double residual = candidates[static_cast<std::size_t>(i)].residual_rad;
      ridge = std::max(ridge, residual);
      if (residual > kClearDescent * ridge) continue;
      const double runner_up = result.runner_up_residual_rad.value_or(std::numeric_limits<double>::infinity());
      result.runner_up_residual_rad = std::min(runner_up, residual);
    }
  }
  return result;
}

}  // namespace cocalib
