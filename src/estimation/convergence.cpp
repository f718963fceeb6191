#include "cocalib/estimation/convergence.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdio>

namespace cocalib {
namespace {

// What a difference may be beyond its covariance, in sigmas of the whole estimate: the noise is learnt on the way and
// the points of linearisation move.
constexpr double kTolerance = 0.5;
// And what it may be at all: a fiftieth of what is wanted. What a lens or an edge gets wrong in all pictures alike does
// not average out, and after minutes of data shows against any covariance.
constexpr double kNegligible_m = 6e-5, kNegligible_rad = 2e-5, kNegligible_s = 1e-5;
constexpr double kFalseAlarmSigmas = 3.72;  // one in ten thousand
constexpr const char* kAxes[] = {"x", "y", "z"};

/// Quantile of the chi-square distribution (Wilson and Hilferty 1931; within 1 % from 3 degrees of freedom on).
double chiSquareLimit(double degrees) {
  const double a = 2.0 / (9.0 * degrees);
  return degrees * std::pow(1.0 - a + kFalseAlarmSigmas * std::sqrt(a), 3.0);
}

Vector14d difference(const Calibration& a, const Calibration& b) {
  Vector14d d;
  d << a.T_imu_camera.minus(b.T_imu_camera), a.T_imu_lidar.minus(b.T_imu_lidar),
      a.camera_time_offset_s - b.camera_time_offset_s, a.lidar_time_offset_s - b.lidar_time_offset_s;
  return d;
}

double negligible(int row) {
  if (row >= 12) return kNegligible_s;
  return row % 6 < 3 ? kNegligible_m : kNegligible_rad;
}

std::string describe(int row, double value) {
  char text[96];
  const char* sensor = row < 6 || row == 12 ? "camera" : "lidar";
  const int part = row % 6;
  if (row >= 12) {
    std::snprintf(text, sizeof text, "%s clock offset by %.2f ms", sensor, 1e3 * std::abs(value));
  } else if (part < 3) {
    std::snprintf(text, sizeof text, "%s translation along imu %s by %.1f mm", sensor, kAxes[part],
                  1e3 * std::abs(value));
  } else {
    std::snprintf(text, sizeof text, "%s rotation about imu %s by %.3f deg", sensor, kAxes[part - 3],
                  std::abs(value) * 57.29578);
  }
  return text;
}

}  // namespace

std::optional<std::string> disagreement(const CalibrationEstimate& part, const CalibrationEstimate& all,
                                        const std::vector<int>& rows) {
  const auto n = static_cast<Eigen::Index>(rows.size());
  const Vector14d whole = difference(all.calibration, part.calibration);
  Eigen::VectorXd d(n), tolerated(n);
  Eigen::MatrixXd spread(n, n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const int row = rows[static_cast<std::size_t>(i)];
    const double sigma_i = std::sqrt(all.covariance(row, row));
    if (!(sigma_i > 0.0)) return std::nullopt;
    d[i] = whole[row] / sigma_i;
    tolerated[i] = std::pow(std::max(kTolerance, negligible(row) / sigma_i), 2.0);
    for (Eigen::Index j = 0; j < n; ++j) {
      const int column = rows[static_cast<std::size_t>(j)];
      const double sigma_j = std::sqrt(all.covariance(column, column));
      spread(i, j) = (part.covariance(row, column) - all.covariance(row, column)) / (sigma_i * sigma_j);
    }
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(spread);
  if (eigen.info() != Eigen::Success) return std::nullopt;
  const auto& Q = eigen.eigenvectors();
  Eigen::MatrixXd expected = Q * eigen.eigenvalues().cwiseMax(0.0).asDiagonal() * Q.transpose();
  expected.diagonal() += tolerated;
  if (d.dot(expected.llt().solve(d)) <= chiSquareLimit(static_cast<double>(n))) return std::nullopt;
  Eigen::Index worst = 0;
  (d.array().abs() / expected.diagonal().array().sqrt()).maxCoeff(&worst);
  const int row = rows[static_cast<std::size_t>(worst)];
  return describe(row, whole[row]);
}

void EstimateHistory::add(const CalibrationEstimate& estimate) {
  if (estimates_.size() >= kMax) {
    std::size_t kept = 0;
    for (std::size_t i = 0; i < estimates_.size(); i += 2) estimates_[kept++] = std::move(estimates_[i]);
    estimates_.resize(kept);
  }
  estimates_.push_back(estimate);
}

const CalibrationEstimate* EstimateHistory::half() const {
  if (estimates_.empty()) return nullptr;
  const double wanted = 0.5 * estimates_.back().duration_s;
  const auto nearest = std::min_element(estimates_.begin(), estimates_.end(), [&](const auto& a, const auto& b) {
    return std::abs(a.duration_s - wanted) < std::abs(b.duration_s - wanted);
  });
  return std::abs(nearest->duration_s - wanted) <= 0.4 * wanted ? &*nearest : nullptr;
}

}  // namespace cocalib
