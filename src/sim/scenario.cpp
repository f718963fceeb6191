#include "cocalib/sim/scenario.h"

#include <Eigen/Geometry>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace cocalib::sim {
namespace {

void requireRange(const char* key, double value, double low, double high, const char* unit) {
  if (value >= low && value <= high) return;  // false for NaN
  std::ostringstream message;
  message << key << ": " << value << " is not allowed; it must lie in [" << low << ", " << high << "] " << unit;
  throw std::invalid_argument(message.str());
}

void requireRange(const char* key, const Eigen::Vector3d& value, double bound, const char* unit) {
  for (int i = 0; i < 3; ++i) requireRange(key, value[i], -bound, bound, unit);
}

void validateImu(const Scenario::Imu& imu) {
  requireRange("imu.rate", imu.rate_hz, 50.0, 2000.0, "Hz");
  requireRange("imu.gyroscope_noise_density", imu.gyro_noise_density, 0.0, 0.1, "rad/s/sqrt(Hz)");
  requireRange("imu.accelerometer_noise_density", imu.accel_noise_density, 0.0, 1.0, "m/s^2/sqrt(Hz)");
  requireRange("imu.gyroscope_bias", imu.gyro_bias, 0.0, 0.5, "rad/s");
  requireRange("imu.accelerometer_bias", imu.accel_bias, 0.0, 5.0, "m/s^2");
  requireRange("imu.gyroscope_random_walk", imu.gyro_bias_walk, 0.0, 0.01, "rad/s^2/sqrt(Hz)");
  requireRange("imu.accelerometer_random_walk", imu.accel_bias_walk, 0.0, 0.1, "m/s^3/sqrt(Hz)");
}

void validateFaults(const Scenario::Camera::Faults& faults) {
  requireRange("camera.faults.blackout (start)", faults.blackout_start_s, 0.0, 36000.0, "s");
  requireRange("camera.faults.blackout (length)", faults.blackout_s, 0.0, 36000.0, "s");
  requireRange("camera.faults.brightness_period", faults.brightness_period_s, 0.0, 60.0, "s (0: never)");
  requireRange("camera.faults.brightness_factor", faults.brightness_factor, 1.0, 10.0, "");
  requireRange("camera.faults.dropped", faults.dropped, 0.0, 0.9, "of the pictures");
  requireRange("camera.faults.moving_object", faults.moving_object, 0.0, 0.8, "of the picture's width");
}

void validateCamera(const Scenario::Camera& camera) {
  requireRange("camera.rate", camera.rate_hz, 1.0, 200.0, "Hz");
  requireRange("camera.mounting_rpy", camera.mounting_rpy, 6.3, "rad");
  requireRange("camera.optical_roll", camera.optical_roll, -6.3, 6.3, "rad");
  requireRange("camera.translation", camera.translation, 2.0, "m");
  requireRange("camera.time_offset", camera.time_offset_s, -0.1, 0.1, "s");
  requireRange("camera.blur", camera.blur_px, 0.0, 5.0, "px");
  requireRange("camera.noise", camera.noise, 0.0, 50.0, "grey levels");
  requireRange("camera.exposure", camera.exposure_s, 0.0, 0.5 / camera.rate_hz, "s (half a frame)");
  requireRange("camera.line_delay", camera.line_delay_s, 0.0, 0.9 / (camera.rate_hz * camera.height),
               "s (the picture must be read out before the next)");
  validateFaults(camera.faults);
  requireRange("camera.corner_noise", camera.corner_noise_px, 0.0, 10.0, "px");
  requireRange("camera.track_noise", camera.track_noise_px, 0.0, 10.0, "px");
  requireRange("camera.resolution (width)", camera.width, 64, 4096, "px");
  requireRange("camera.resolution (height)", camera.height, 64, 4096, "px");
  try {
    camera.cameraModel();
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(std::string("camera: ") + error.what());
  }
}

void validateLidar(const Scenario::Lidar& lidar) {
  requireRange("lidar.rate", lidar.rate_hz, 5.0, 20.0, "Hz");
  requireRange("lidar.range_noise", lidar.range_noise_m, 0.0, 0.5, "m");
  requireRange("lidar.min_range", lidar.min_range_m, 0.0, 5.0, "m");
  requireRange("lidar.max_range", lidar.max_range_m, lidar.min_range_m, 500.0, "m (at least min_range)");
  requireRange("lidar.max_incidence", lidar.max_incidence_rad, 0.5, 1.5708, "rad");
  requireRange("lidar.mounting_rpy", lidar.mounting_rpy, 6.3, "rad");
  requireRange("lidar.translation", lidar.translation, 2.0, "m");
  requireRange("lidar.time_offset", lidar.time_offset_s, -0.1, 0.1, "s");
}

void validateBoard(const Scenario::Board& board) {
  requireRange("board.cols", board.cols, 3, 30, "inner corners");
  requireRange("board.rows", board.rows, 3, 30, "inner corners");
  requireRange("board.square", board.square_m, 0.01, 0.5, "m");
  requireRange("board.width", board.width_m, (board.cols + 1) * board.square_m, 3.0, "m (at least its squares)");
  requireRange("board.height", board.height_m, (board.rows + 1) * board.square_m, 2.4, "m (at least its squares)");
  requireRange("board.distance", board.distance_m, 1.0, 5.0, "m");
  requireRange("board.tilt_rpy", board.tilt_rpy, 1.2, "rad");
}

}  // namespace

Eigen::Matrix3d rotationFromRpy(const Eigen::Vector3d& rpy) {
  const double cr = std::cos(rpy[0]), sr = std::sin(rpy[0]);
  const double cp = std::cos(rpy[1]), sp = std::sin(rpy[1]);
  const double cy = std::cos(rpy[2]), sy = std::sin(rpy[2]);
  Eigen::Matrix3d R;
  R << cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr,  //
      sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr,   //
      -sp, cp * sr, cp * cr;
  return R;
}

CameraModel Scenario::Camera::cameraModel() const {
  return CameraModel::fromName(model, intrinsics, distortion, width, height);
}

Pose Scenario::Camera::T_imu_camera() const {
  Eigen::Matrix3d R_body_optical;  // x right, y down, z forward, in axes x forward, y left, z up
  R_body_optical << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  const Eigen::Matrix3d R_roll = Eigen::AngleAxisd(optical_roll, Eigen::Vector3d::UnitZ()).toRotationMatrix();
  return {Eigen::Quaterniond(Eigen::Matrix3d(rotationFromRpy(mounting_rpy) * R_body_optical * R_roll)), translation};
}

Pose Scenario::Lidar::T_imu_lidar() const { return {Eigen::Quaterniond(rotationFromRpy(mounting_rpy)), translation}; }

BoardGeometry Scenario::Board::geometry() const {
  BoardGeometry geometry;
  geometry.cols = cols;
  geometry.rows = rows;
  geometry.square_m = square_m;
  geometry.width_m = width_m;
  geometry.height_m = height_m;
  return geometry;
}

void Scenario::validate() const {
  requireRange("duration", duration_s, 1.0, 36000.0, "s");
  requireRange("gravity", gravity, 9.7, 9.9, "m/s^2");
  requireRange("ramp", ramp_s, 0.5, 60.0, "s");
  requireRange("planar_for", planar_for_s, 0.0, 36000.0, "s");
  requireRange("parked_after", parked_after_s, 0.0, 36000.0, "s");
  if (parked_after_s > 0.0 && place == Place::kBuilding) {
    throw std::invalid_argument("'parked_after' must be 0 in a building, through which the rig is driven on and on");
  }
  validateImu(imu);
  if (camera.present) validateCamera(camera);
  validateLidar(lidar);
  if (board.present) validateBoard(board);
}

}  // namespace cocalib::sim
