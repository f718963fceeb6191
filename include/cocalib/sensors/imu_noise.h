#pragma once

namespace cocalib {

/// Continuous-time noise of an IMU, as data sheets and Allan plots give it.
struct ImuNoise {
  double gyro_noise_density = 1.745e-4;   ///< [rad/s/sqrt(Hz)]
  double gyro_bias_walk = 1.0e-6;         ///< [rad/s^2/sqrt(Hz)]
  double accel_noise_density = 5.884e-4;  ///< [m/s^2/sqrt(Hz)]
  double accel_bias_walk = 1.0e-5;        ///< [m/s^3/sqrt(Hz)]
};

}  // namespace cocalib
