#include "cocalib/sim/truth_file.h"

#include <algorithm>
#include <iomanip>
#include <sstream>
#include <vector>

#include "cocalib/sim/imu.h"

namespace cocalib::sim {
namespace {

std::string number(double value) {
  std::ostringstream text;
  text << std::setprecision(12) << value;
  // YAML 1.1 readers take 1e-06 for text, 1.0e-06 for a number.
  std::string result = text.str();
  const std::size_t exponent = result.find('e');
  if (exponent != std::string::npos && result.find('.') == std::string::npos) result.insert(exponent, ".0");
  return result;
}

template <typename Vector>
std::string list(const Vector& values) {
  std::string text;
  for (const double value : values) text += (text.empty() ? "" : ", ") + number(value);
  return "[" + text + "]";
}

std::string vector3(const Eigen::Vector3d& v) { return list(std::vector<double>{v.x(), v.y(), v.z()}); }

std::string pose(const Pose& T) {
  return "{translation: " + vector3(T.t) +
         ", rotation_xyzw: " + list(std::vector<double>{T.q.x(), T.q.y(), T.q.z(), T.q.w()}) + "}";
}

// Seconds since 1970 with all nine decimals, which a double does not hold.
std::string stamp(TimeNs time) {
  std::ostringstream text;
  text << time / 1000000000 << "." << std::setw(9) << std::setfill('0') << time % 1000000000;
  return text.str();
}

}  // namespace

std::string truthText(const Scenario& scenario, const Scene& scene, const Trajectory& trajectory) {
  std::vector<ImuBias> biases;
  simulateImu(scenario, trajectory, &biases);
  std::ostringstream text;
  text << "# Truth of a simulated recording; units m, rad, s. T_A_B takes coordinates in B to A.\n"
       << "scenario: \"" << scenario.name << "\"\n"
       << "seed: " << scenario.seed << "\n"
       << "duration: " << number(scenario.duration_s) << "\n"
       << "lidar:\n"
       << "  T_imu_lidar: " << pose(scenario.lidar.T_imu_lidar()) << "\n"
       << "  time_offset: " << number(scenario.lidar.time_offset_s) << "  # t_imu = t_lidar + time_offset\n"
       << "imu:  # biases at the first and at the last sample\n"
       << "  gyroscope_bias: " << vector3(biases.front().gyro) << "\n"
       << "  accelerometer_bias: " << vector3(biases.front().accel) << "\n"
       << "  gyroscope_bias_at_end: " << vector3(biases.back().gyro) << "\n"
       << "  accelerometer_bias_at_end: " << vector3(biases.back().accel) << "\n"
       << "  gravity: " << number(scenario.gravity) << "\n";
  if (scenario.camera.present) {
    text << "camera:\n"
         << "  T_imu_camera: " << pose(scenario.camera.T_imu_camera()) << "\n"
         << "  time_offset: " << number(scenario.camera.time_offset_s) << "  # t_imu = t_camera + time_offset\n"
         << "lidar_camera:\n"
         << "  T_lidar_camera: " << pose(scenario.lidar.T_imu_lidar().inverse() * scenario.camera.T_imu_camera())
         << "\n";
  }
  if (scene.boardIndex() >= 0) text << "board:\n  T_world_board: " << pose(scene.T_W_B()) << "\n";
  text << "trajectory:  # [stamp on the IMU clock, x, y, z, qx, qy, qz, qw] of T_world_imu\n";
  for (int i = 0; i <= static_cast<int>(10.0 * scenario.duration_s); ++i) {
    const NavState state = trajectory.stateAt(trajectory.stampOf(0.1 * i));
    const Pose& T = state.T_W_I;
    const std::string values = list(std::vector<double>{T.t.x(), T.t.y(), T.t.z(), T.q.x(), T.q.y(), T.q.z(), T.q.w()});
    text << "  - [" << stamp(state.stamp) << ", " << values.substr(1) << "\n";
  }
  return text.str();
}

std::string rigText(const Scenario& scenario) {
  // A rig file needs some bias walk; a data sheet's figure does no harm where the simulated bias stands still.
  const double gyro_walk = std::max(scenario.imu.gyro_bias_walk, 1.0e-6);
  const double accel_walk = std::max(scenario.imu.accel_bias_walk, 1.0e-5);
  const double gyro_noise = std::max(scenario.imu.gyro_noise_density, 1.0e-6);
  const double accel_noise = std::max(scenario.imu.accel_noise_density, 1.0e-5);
  const std::string suffix = scenario.camera.transport == "raw" ? "" : "/compressed";
  std::ostringstream text;
  text << "# Rig of the simulated recording '" << scenario.name << "'. No initial guess is given.\n"
       << "imu:\n"
       << "  topic: " << scenario.imu_topic << "\n"
       << "  frame: " << scenario.imu_frame << "\n"
       << "  gyroscope_noise_density: " << number(gyro_noise) << "      # rad/s/sqrt(Hz)\n"
       << "  gyroscope_random_walk: " << number(gyro_walk) << "         # rad/s^2/sqrt(Hz)\n"
       << "  accelerometer_noise_density: " << number(accel_noise) << "   # m/s^2/sqrt(Hz)\n"
       << "  accelerometer_random_walk: " << number(accel_walk) << "     # m/s^3/sqrt(Hz)\n";
  if (scenario.camera.present) {
    text << "camera:\n"
         << "  topic: " << scenario.camera.topic << suffix << "\n"
         << "  info_topic: " << scenario.camera.info_topic << "\n"
         << "  frame: " << scenario.camera.frame << "\n";
  }
  text << "lidar:\n"
       << "  topic: " << scenario.lidar.topic << "\n"
       << "  frame: " << scenario.lidar.frame << "\n"
       << "  range_noise: " << number(std::max(scenario.lidar.range_noise_m, 0.001)) << "  # m, 1 sigma\n";
  if (scenario.board.present && scenario.camera.present) {
    text << "target:\n"
         << "  type: checkerboard\n"
         << "  cols: " << scenario.board.cols << "           # inner corners\n"
         << "  rows: " << scenario.board.rows << "\n"
         << "  square: " << number(scenario.board.square_m) << "       # m\n"
         << "  board_width: " << number(scenario.board.width_m) << "    # m, outer edges\n"
         << "  board_height: " << number(scenario.board.height_m) << "\n";
  }
  return text.str();
}

}  // namespace cocalib::sim
