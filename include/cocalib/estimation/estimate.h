#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "cocalib/geometry/pose.h"
#include "cocalib/geometry/time.h"

namespace cocalib {

using Vector14d = Eigen::Matrix<double, 14, 1>;
using Matrix14d = Eigen::Matrix<double, 14, 14>;

/// What is calibrated: both mountings and both clocks. t_imu = t_sensor + time_offset.
struct Calibration {
  Pose T_imu_camera;
  Pose T_imu_lidar;
  double camera_time_offset_s = 0.0;
  double lidar_time_offset_s = 0.0;

  Pose T_lidar_camera() const { return T_imu_lidar.inverse() * T_imu_camera; }
};

enum class Status { kInsufficientData, kUnobservable, kConverging, kConverged };

/// "insufficient_data" | "unobservable" | "converging" | "converged", as result files and messages say it.
const char* toString(Status status);

/// One sensor against the IMU (or, for lidar_camera, the camera against the lidar).
struct SensorVerdict {
  bool valid = false;                                                       ///< an estimate exists at all
  Eigen::Matrix<double, 6, 1> sigma = Eigen::Matrix<double, 6, 1>::Zero();  ///< translation [m], rotation [rad]
  double time_offset_sigma_s = 0.0;
  std::vector<std::string> unobservable;  ///< in words: "translation along imu z: no rotation about x or y yet"
};

/// How well the estimate explains the data.
struct Quality {
  double reprojection_rms_px = 0.0;
  double lidar_plane_rms_m = 0.0;
  int board_views = 0;
  int board_lidar_points = 0;
  int keyframes = 0;
};

/// Everything an estimator says at one time.
struct CalibrationEstimate {
  Status status = Status::kInsufficientData;
  TimeNs stamp = 0;         ///< of the last measurement used, IMU clock
  double duration_s = 0.0;  ///< of data used
  Calibration calibration;
  /// Order: camera t, r, lidar t, r, camera offset, lidar offset; m, rad, s.
  Matrix14d covariance = Matrix14d::Zero();
  SensorVerdict camera, lidar, lidar_camera;
  Eigen::Vector3d gyro_bias = Eigen::Vector3d::Zero();   ///< [rad/s]
  Eigen::Vector3d accel_bias = Eigen::Vector3d::Zero();  ///< [m/s^2]
  double gravity = 9.80665;                              ///< [m/s^2]
  Quality quality;
  std::string message;  ///< for the user: what happens, what is missing
};

/// 6x6 covariance of T_lidar_camera, over its own tangent (in the lidar frame), from the joint covariance.
Matrix6d lidarCameraCovariance(const Calibration& calibration, const Matrix14d& covariance);

}  // namespace cocalib
