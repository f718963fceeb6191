#pragma once

#include "cocalib/estimation/estimate.h"

namespace cocalib {

/// What is known before any data, 1 sigma each; centred on the state at reset().
struct WindowPriors {
  double camera_translation_m = 1.0, lidar_translation_m = 1.0;
  double extrinsic_rotation_rad = 0.5;
  double time_offset_s = 0.1;
  double gravity = 0.03;     ///< of its magnitude over the earth and with height [m/s^2]
  double gyro_bias = 0.2;    ///< [rad/s]
  double accel_bias = 0.5;   ///< [m/s^2]
  double outline_m = 0.002;  ///< of the plate's edges where the rig file gives its size
};

/// A calibration that is known from earlier data, and how well.
struct CalibrationPrior {
  Calibration mean;
  Matrix14d covariance = Matrix14d::Identity();  ///< in the order of CalibrationEstimate; regular
};

/// An earlier result as a prior. What it does not hold is as unknown as without it.
CalibrationPrior priorFrom(const CalibrationEstimate& earlier);

}  // namespace cocalib
