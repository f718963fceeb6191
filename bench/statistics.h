#pragma once

#include <string>
#include <vector>

#include "trial.h"

namespace cocalib::bench {

/// Errors of many trials against their covariances and against the Cramer-Rao bound.
class Statistics {
 public:
  /// @param name    of the estimator, for the headings
  /// @param camera  whether it estimates the camera's seven parameters, and `lidar` the lidar's
  Statistics(std::string name, bool camera, bool lidar) : name_(std::move(name)), camera_(camera), lidar_(lidar) {}

  void add(const CalibrationEstimate& estimate, const Calibration& truth);
  std::size_t count() const { return errors_.size(); }
  /// Squared error over covariance of the trial added last, over all parameters estimated.
  double newestNees() const;

  /// RMSE, mean sigma and their ratio for each parameter, norms over three axes, NEES with its 95 % band, and
  /// how many errors are beyond three sigma.
  std::string table() const;

 private:
  struct Norms {
    double rotation_mrad, translation_mm;
  };
  Norms normsOf(int first) const;
  Norms lidarCameraNorms() const;
  double nees(std::size_t trial, const std::vector<int>& rows) const;
  std::string neesLine(const char* what, const std::vector<int>& rows) const;
  std::string tailLine() const;
  std::vector<int> estimated() const;

  std::string name_;
  bool camera_, lidar_;
  std::vector<Vector14d> errors_;
  std::vector<Matrix14d> covariances_;
  std::vector<Vector6d> lidar_camera_errors_;
  std::vector<Matrix6d> lidar_camera_covariances_;
};

/// Error of every published parameter in the order of CalibrationEstimate::covariance; m, rad, s.
Vector14d errorOf(const Calibration& estimate, const Calibration& truth);

/// The two calibrators' estimates side by side, as if they knew nothing of each other.
CalibrationEstimate twoStep(const CalibrationEstimate& visual, const CalibrationEstimate& lidar);

}  // namespace cocalib::bench
