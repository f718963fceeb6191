#include "cocalib/monitor/progress.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>

namespace cocalib {
namespace {

constexpr double kDeg = 180.0 / M_PI;
constexpr double kForecastSpanS = 12.0;  // over which the gain of information is measured
constexpr double kLongestForecastS = 600.0;
constexpr const char* kAxes[] = {"x", "y", "z"};

template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[240];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

/// 1 sigma at which each parameter counts as calibrated, in the order of the joint covariance.
Vector14d limits(const ObservabilityThresholds& thresholds) {
  Vector14d limit;
  limit << Eigen::Vector3d::Constant(thresholds.converged_translation_m),
      Eigen::Vector3d::Constant(thresholds.converged_rotation_rad),
      Eigen::Vector3d::Constant(thresholds.converged_translation_m),
      Eigen::Vector3d::Constant(thresholds.converged_rotation_rad), thresholds.converged_time_offset_s,
      thresholds.converged_time_offset_s;
  return limit;
}

/// The direction of one sensor's pose that is known least.
struct Weakest {
  double size = 0.0;                      ///< 1 sigma, in thresholds
  Vector6d direction = Vector6d::Zero();  ///< in thresholds, unit length
  const char* sensor = "";
  Matrix6d covariance = Matrix6d::Zero();
};

Weakest weakestOf(const CalibrationEstimate& estimate, const ObservabilityThresholds& thresholds) {
  const Vector14d limit = limits(thresholds);
  Weakest weakest;
  const auto look = [&](int first, const char* sensor, const SensorVerdict& verdict) {
    const Matrix6d P = estimate.covariance.block<6, 6>(first, first);
    if (!verdict.valid || !P.allFinite()) return;
    const Vector6d scale = limit.segment<6>(first).cwiseInverse();
    const Eigen::SelfAdjointEigenSolver<Matrix6d> solver(scale.asDiagonal() * P * scale.asDiagonal());
    const double size = std::sqrt(std::max(0.0, solver.eigenvalues()[5]));
    if (size > weakest.size) weakest = {size, solver.eigenvectors().col(5), sensor, P};
  };
  look(0, "camera", estimate.camera);
  look(6, "lidar", estimate.lidar);
  return weakest;
}

/// The IMU axis about which the rig has turned least, other than `along` (-1: any). Of two that hardly differ the first
/// one, so that the advice does not change with every estimate.
int leastTurned(const Eigen::Vector3d& turned_rad, int along) {
  constexpr double kLess_rad = 0.1, kLess = 0.1;
  int best = -1;
  for (int axis = 0; axis < 3; ++axis) {
    if (axis == along) continue;
    if (best < 0 || turned_rad[axis] < turned_rad[best] - std::max(kLess_rad, kLess * turned_rad[best])) best = axis;
  }
  return best;
}

/// How well one parameter of a pose is known, in words.
std::string knowledge(int row, double sigma, const ObservabilityThresholds& thresholds) {
  const char* axis = kAxes[row % 3];
  if (row < 3) {
    const std::string what = format("translation along imu %s ", axis);
    return what + (sigma > thresholds.unobservable_translation_m ? "does not show yet"
                                                                 : format("is known to %.1f mm", 1e3 * sigma));
  }
  const std::string what = format("rotation about imu %s ", axis);
  return what + (sigma > thresholds.unobservable_rotation_rad ? "does not show yet"
                                                              : format("is known to %.3f deg", kDeg * sigma));
}

MotionHint turnAbout(int axis, const std::string& why) {
  return {Eigen::Vector3d::Unit(axis), std::string("turn about imu ") + kAxes[axis] + ", back and forth: " + why};
}

std::string sensorWords(const char* name, const SensorVerdict& verdict, const ObservabilityThresholds& thresholds) {
  if (!verdict.valid) return "";
  const Vector6d& s = verdict.sigma;
  return format(" | %s +- %.1f %.1f %.1f mm (%.1f), %.3f %.3f %.3f deg (%.3f), %.2f ms (%.2f)", name, 1e3 * s[0],
                1e3 * s[1], 1e3 * s[2], 1e3 * thresholds.converged_translation_m, kDeg * s[3], kDeg * s[4], kDeg * s[5],
                kDeg * thresholds.converged_rotation_rad, 1e3 * verdict.time_offset_sigma_s,
                1e3 * thresholds.converged_time_offset_s);
}

}  // namespace

std::optional<MotionHint> adviseMotion(const CalibrationEstimate& estimate, const Eigen::Vector3d& turned_rad,
                                       const ObservabilityThresholds& thresholds) {
  if (!estimate.camera.valid && !estimate.lidar.valid) {
    return turnAbout(leastTurned(turned_rad, -1),
                     format("the rig has turned %.0f, %.0f, %.0f deg about x, y, z so far", kDeg * turned_rad.x(),
                            kDeg * turned_rad.y(), kDeg * turned_rad.z()));
  }
  const Weakest weakest = weakestOf(estimate, thresholds);
  if (weakest.size <= 1.0) return std::nullopt;
  const bool translation = weakest.direction.head<3>().norm() >= weakest.direction.tail<3>().norm();
  const Eigen::Vector3d direction = translation ? weakest.direction.head<3>() : weakest.direction.tail<3>();
  int along = 0;
  direction.cwiseAbs().maxCoeff(&along);
  // A lever arm shows when the rig turns across it, an angle of the mounting when it turns about the other two axes.
  const int row = along + (translation ? 0 : 3);
  const double sigma = std::sqrt(weakest.covariance(row, row));
  return turnAbout(leastTurned(turned_rad, along),
                   std::string(weakest.sensor) + " " + knowledge(row, sigma, thresholds));
}

void ProgressForecast::add(const CalibrationEstimate& estimate) {
  Entry entry = {estimate.duration_s, Vector14d::Zero()};
  const Vector14d limit = limits(thresholds_);
  for (int i = 0; i < 14; ++i) {
    const bool known = i < 6 || i == 12 ? estimate.camera.valid : estimate.lidar.valid;
    const double variance = estimate.covariance(i, i);
    if (known && variance > 0.0) entry.information[i] = limit[i] * limit[i] / variance;
  }
  if (!entries_.empty() && entry.duration_s < entries_.back().duration_s) entries_.clear();
  entries_.push_back(entry);
  while (entries_.size() > 2 && entries_.back().duration_s - entries_[1].duration_s >= kForecastSpanS) {
    entries_.pop_front();
  }
}

std::optional<double> ProgressForecast::secondsLeft() const {
  if (entries_.empty() || entries_.back().information.maxCoeff() <= 0.0) return std::nullopt;
  const Entry &first = entries_.front(), &last = entries_.back();
  const double span_s = last.duration_s - first.duration_s;
  double longest_s = 0.0;
  for (int i = 0; i < 14; ++i) {
    if (last.information[i] <= 0.0 || last.information[i] >= 1.0) continue;
    const double gain = span_s > 0.0 ? (last.information[i] - first.information[i]) / span_s : 0.0;
    if (gain <= 0.0) return std::nullopt;
    longest_s = std::max(longest_s, (1.0 - last.information[i]) / gain);
  }
  if (longest_s > kLongestForecastS) return std::nullopt;
  return longest_s;
}

std::string nextStep(const CalibrationEstimate& estimate, const std::string& stage,
                     const std::optional<MotionHint>& hint) {
  if (hint) return hint->words;
  if (stage != toString(estimate.status)) return "";
  return estimate.status == Status::kConverged ? "save or freeze it, or end with Ctrl-C" : "keep moving like this";
}

std::string progressWords(const CalibrationEstimate& estimate, const std::string& stage,
                          const ObservabilityThresholds& thresholds, const std::optional<double>& seconds_left,
                          const std::optional<MotionHint>& hint) {
  const bool waiting = !estimate.camera.valid && !estimate.lidar.valid && !estimate.message.empty();
  const bool repeats = estimate.message.compare(0, stage.size(), stage) == 0;
  std::string text = format("%.0f s, ", estimate.duration_s) + (waiting && repeats ? "" : stage);
  if (waiting) text += (repeats ? "" : ": ") + estimate.message;
  text += sensorWords("camera", estimate.camera, thresholds) + sensorWords("lidar", estimate.lidar, thresholds);
  if (const std::string step = nextStep(estimate, stage, hint); !step.empty()) text += " | " + step;
  if (seconds_left && *seconds_left > 0.0)
    text += format(" | about %.0f s more of such motion", std::ceil(*seconds_left));
  return text;
}

}  // namespace cocalib
