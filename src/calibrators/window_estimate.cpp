#include "cocalib/calibrators/window_estimate.h"

namespace cocalib {

bool readEstimate(InertialWindow* window, CalibrationEstimate* estimate) {
  Matrix14d covariance;
  if (!window->calibrationCovariance(&covariance)) return false;
  const WindowState& state = window->state();
  const NavState& newest = state.nodes.back();
  estimate->stamp = newest.stamp;
  estimate->calibration = state.calibration;
  estimate->covariance = covariance;
  estimate->gyro_bias = newest.gyro_bias;
  estimate->accel_bias = newest.accel_bias;
  estimate->gravity = state.gravity;
  return true;
}

}  // namespace cocalib
