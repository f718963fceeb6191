#include "statistics.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/math/distributions/chi_squared.hpp>
#include <cmath>
#include <cstdio>

namespace cocalib::bench {
namespace {

constexpr const char* kNames[14] = {"camera tx mm",   "camera ty mm",   "camera tz mm",  "camera rx mrad",
                                    "camera ry mrad", "camera rz mrad", "lidar tx mm",   "lidar ty mm",
                                    "lidar tz mm",    "lidar rx mrad",  "lidar ry mrad", "lidar rz mrad",
                                    "camera td ms",   "lidar td ms"};
constexpr double kMilli = 1e3;

template <typename... Values>
std::string line(const char* format, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, format, values...);
  return text;
}

double meanSquare(const std::vector<Vector14d>& errors, int row) {
  double sum = 0.0;
  for (const Vector14d& error : errors) sum += error[row] * error[row];
  return sum / static_cast<double>(errors.size());
}

}  // namespace

Vector14d errorOf(const Calibration& estimate, const Calibration& truth) {
  Vector14d error;
  error << estimate.T_imu_camera.minus(truth.T_imu_camera), estimate.T_imu_lidar.minus(truth.T_imu_lidar),
      estimate.camera_time_offset_s - truth.camera_time_offset_s,
      estimate.lidar_time_offset_s - truth.lidar_time_offset_s;
  return error;
}

CalibrationEstimate twoStep(const CalibrationEstimate& visual, const CalibrationEstimate& lidar) {
  CalibrationEstimate out = visual;
  out.calibration.T_imu_lidar = lidar.calibration.T_imu_lidar;
  out.calibration.lidar_time_offset_s = lidar.calibration.lidar_time_offset_s;
  out.covariance.setZero();
  const std::vector<int> own_lidar = {6, 7, 8, 9, 10, 11, 13}, own_camera = {0, 1, 2, 3, 4, 5, 12};
  for (const int i : own_camera) {
    for (const int j : own_camera) out.covariance(i, j) = visual.covariance(i, j);
  }
  for (const int i : own_lidar) {
    for (const int j : own_lidar) out.covariance(i, j) = lidar.covariance(i, j);
  }
  return out;
}

void Statistics::add(const CalibrationEstimate& estimate, const Calibration& truth) {
  errors_.push_back(errorOf(estimate.calibration, truth));
  covariances_.push_back(estimate.covariance);
  lidar_camera_errors_.push_back(estimate.calibration.T_lidar_camera().minus(truth.T_lidar_camera()));
  lidar_camera_covariances_.push_back(lidarCameraCovariance(estimate.calibration, estimate.covariance));
}

std::vector<int> Statistics::estimated() const {
  std::vector<int> rows;
  for (int i = 0; i < 14; ++i) {
    const bool of_camera = i < 6 || i == 12;
    if (of_camera ? camera_ : lidar_) rows.push_back(i);
  }
  return rows;
}

Statistics::Norms Statistics::normsOf(int first) const {
  double translation = 0.0, rotation = 0.0;
  for (int i = 0; i < 3; ++i) {
    translation += meanSquare(errors_, first + i);
    rotation += meanSquare(errors_, first + 3 + i);
  }
  return {kMilli * std::sqrt(rotation), kMilli * std::sqrt(translation)};
}

Statistics::Norms Statistics::lidarCameraNorms() const {
  double translation = 0.0, rotation = 0.0;
  for (const Vector6d& error : lidar_camera_errors_) {
    translation += error.head<3>().squaredNorm();
    rotation += error.tail<3>().squaredNorm();
  }
  const auto n = static_cast<double>(lidar_camera_errors_.size());
  return {kMilli * std::sqrt(rotation / n), kMilli * std::sqrt(translation / n)};
}

double Statistics::nees(std::size_t trial, const std::vector<int>& rows) const {
  const auto n = static_cast<Eigen::Index>(rows.size());
  Eigen::VectorXd error(n);
  Eigen::MatrixXd covariance(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const int row = rows[static_cast<std::size_t>(i)];
    error[i] = errors_[trial][row];
    for (Eigen::Index j = 0; j < n; ++j) covariance(i, j) = covariances_[trial](row, rows[static_cast<std::size_t>(j)]);
  }
  return error.dot(covariance.ldlt().solve(error));
}

double Statistics::newestNees() const { return nees(errors_.size() - 1, estimated()); }

std::string Statistics::neesLine(const char* what, const std::vector<int>& rows) const {
  const auto n = static_cast<Eigen::Index>(rows.size());
  double sum = 0.0;
  for (std::size_t k = 0; k < errors_.size(); ++k) sum += nees(k, rows);
  // The sum over trials of a chi-square variable of n degrees is one of n times their number.
  const auto trials = static_cast<double>(errors_.size());
  const boost::math::chi_squared chi(trials * static_cast<double>(n));
  return line("NEES of %s: %.2f per trial; 95 %% band %.2f .. %.2f\n", what, sum / trials,
              boost::math::quantile(chi, 0.025) / trials, boost::math::quantile(chi, 0.975) / trials);
}

std::string Statistics::tailLine() const {
  constexpr double kNormalTail = 0.0027;  // of a normal variable, beyond three sigma
  std::vector<double> ratios;
  for (std::size_t k = 0; k < errors_.size(); ++k) {
    for (const int i : estimated()) ratios.push_back(std::abs(errors_[k][i]) / std::sqrt(covariances_[k](i, i)));
    for (int i = 0; i < 6 && camera_ && lidar_; ++i) {
      ratios.push_back(std::abs(lidar_camera_errors_[k][i]) / std::sqrt(lidar_camera_covariances_[k](i, i)));
    }
  }
  const auto beyond = std::count_if(ratios.begin(), ratios.end(), [](double ratio) { return ratio > 3.0; });
  return line("largest error: %.2f sigma; %ld of %zu are beyond 3 (of normal numbers %.1f would be)\n",
              *std::max_element(ratios.begin(), ratios.end()), static_cast<long>(beyond), ratios.size(),
              kNormalTail * static_cast<double>(ratios.size()));
}

std::string Statistics::table() const {
  if (errors_.empty()) return name_ + ": no trial\n";
  std::string text = line("\n%s, %zu trials\n%-16s %10s %10s %10s %10s\n", name_.c_str(), errors_.size(), "", "mean",
                          "RMSE", "sigma", "RMSE/sigma");
  const auto n = static_cast<double>(errors_.size());
  for (const int i : estimated()) {
    double mean = 0.0, variance = 0.0;
    for (std::size_t k = 0; k < errors_.size(); ++k) {
      mean += errors_[k][i] / n;
      variance += covariances_[k](i, i) / n;
    }
    const double rmse = std::sqrt(meanSquare(errors_, i)), sigma = std::sqrt(variance);
    text += line("%-16s %10.4f %10.4f %10.4f %10.2f\n", kNames[i], kMilli * mean, kMilli * rmse, kMilli * sigma,
                 rmse / sigma);
  }
  const char* norms = "%-16s %8.4f mrad %8.4f mm\n";
  if (camera_) text += line(norms, "T_imu_camera", normsOf(0).rotation_mrad, normsOf(0).translation_mm);
  if (lidar_) text += line(norms, "T_imu_lidar", normsOf(6).rotation_mrad, normsOf(6).translation_mm);
  if (camera_ && lidar_) {
    text += line(norms, "T_lidar_camera", lidarCameraNorms().rotation_mrad, lidarCameraNorms().translation_mm);
    Vector6d mean = Vector6d::Zero(), square = Vector6d::Zero(), variance = Vector6d::Zero();
    for (std::size_t k = 0; k < errors_.size(); ++k) {
      mean += lidar_camera_errors_[k] / n;
      square += lidar_camera_errors_[k].cwiseAbs2() / n;
      variance += lidar_camera_covariances_[k].diagonal() / n;
    }
    for (int i = 0; i < 6; ++i) {
      text +=
          line("  lidar_camera %s%c %10.4f %10.4f %10.4f %10.2f\n", i < 3 ? "t" : "r", "xyz"[i % 3], kMilli * mean[i],
               kMilli * std::sqrt(square[i]), kMilli * std::sqrt(variance[i]), std::sqrt(square[i] / variance[i]));
    }
  }
  if (camera_) text += neesLine("camera (7)", {0, 1, 2, 3, 4, 5, 12});
  if (lidar_) text += neesLine("lidar (7)", {6, 7, 8, 9, 10, 11, 13});
  if (camera_ && lidar_) text += neesLine("all (14)", estimated());
  text += tailLine();
  return text;
}

}  // namespace cocalib::bench
