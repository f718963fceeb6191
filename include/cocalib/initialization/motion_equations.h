#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "cocalib/initialization/alignment.h"
#include "cocalib/initialization/inertial_path.h"
#include "cocalib/initialization/rotation_minimum.h"

namespace cocalib {

/// Rates of turn and second differences of position of a sensor, as linear equations in its mounting rotation.
///
/// With Y = R_sensor_imu, biases b, lever arm m = Y t_imu_sensor (in the sensor frame) and gravity g in the map:
///
///   rate:          w_S  = Y w_I - Y b_g
///   acceleration:  D[p] = D[int int R_M_S Y (f_I - b_a)] + D[t^2 / 2] g + D[R_M_S] m
///
/// D is the second difference over three poses; for it the double integral from any start is exact. Orientation comes
/// from the sensor, so nothing but Y has to be searched for: all else is linear and eliminated.
class MotionEquations {
 public:
  struct Settings {
    double span_s = 1.0;        ///< from the middle pose of a second difference to both others
    double max_offset_s = 0.3;  ///< of the clocks, that at() may be asked for, each way
    double position_sigma_m = 0.02;
    double rotation_sigma_rad = 2e-3;
  };
  /// @pre poses rise in time, and the IMU covers them at every offset
  MotionEquations(const ImuBuffer& imu, const std::vector<SensorPose>& poses, const Settings& settings);

  /// Too few poses without gaps: there is nothing to solve.
  bool empty() const { return triples_.size() < kFewest || pairs_.size() < kFewest || !gyro_; }

  /// The equations at one clock offset, all but the rotation eliminated.
  RotationQuadratic at(double offset_s);

  // From a rotation for the offset of the last at():

  /// Weighs outliers down, and sets the noise to what the residuals show.
  void reweight(const Eigen::Matrix3d& R_sensor_imu);
  /// Length of the accelerations' residuals against that of the accelerations, by their medians.
  double unexplained(const Eigen::Matrix3d& R_sensor_imu) const;
  Eigen::Vector3d gyroBias(const Eigen::Matrix3d& R_sensor_imu) const;

 private:
  static constexpr std::size_t kFewest = 8;
  static constexpr int kUnknowns = 21;  // Y column after column, Y b_g, Y b_a, g, m
  using Unknowns = Eigen::Matrix<double, kUnknowns, 1>;
  struct Equation {
    Eigen::Matrix<double, 3, kUnknowns> J = Eigen::Matrix<double, 3, kUnknowns>::Zero();
    Eigen::Vector3d known = Eigen::Vector3d::Zero();
    double sigma = 1.0, weight = 1.0;
  };
  struct Triple {
    std::size_t before, middle, after;
  };
  /// Second integral of (f_x R, f_y R, f_z R, R) up to a pose, R = R_M_S.
  using Integral = Eigen::Matrix<double, 3, 12>;

  void choosePairs(const ImuBuffer& imu);
  void chooseTriples();
  void tabulate(const ImuBuffer& imu);
  Eigen::Vector3d forceAt(TimeNs stamp) const;
  std::vector<Integral> integrate(double offset_s) const;
  void fillRates(double offset_s);
  void fillAccelerations(double offset_s);
  Unknowns solutionFor(const Eigen::Matrix3d& R_sensor_imu) const;
  void reweight(std::size_t begin, std::size_t end, const Unknowns& solution);
  std::vector<double> residualLengths(std::size_t begin, std::size_t end, const Unknowns& solution) const;

  const std::vector<SensorPose>& poses_;
  Settings settings_;
  std::optional<InertialPath> gyro_;
  std::vector<RelativeSensorRotation> pairs_;
  std::vector<Triple> triples_;
  double overlap_ = 1.0;  ///< second differences that share a pose with one of them
  TimeNs table_start_ = 0, grid_start_ = 0;
  std::vector<Eigen::Vector3d> force_;  ///< specific force, evenly spaced from table_start_
  std::vector<Eigen::Matrix3d> R_M_S_;  ///< evenly spaced from grid_start_
  std::vector<Equation> equations_;     ///< of pairs_, then of triples_
  Eigen::Matrix<double, kUnknowns, kUnknowns> H_;
  Unknowns b_;
};

}  // namespace cocalib
