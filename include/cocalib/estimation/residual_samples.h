#pragma once

#include <vector>


namespace cocalib {

class InertialWindow;

/// What the estimate leaves unexplained, sensor by sensor, each beside the noise (1 sigma) that was assumed for it.
struct ResidualSamples {
  std::vector<float> imu_sigmas;  ///< whitened: position, rotation and velocity of every segment; assumed: 1
  std::vector<float> corners_px, tracks_px, planes_m;
  double corner_sigma_px = 0.0, track_sigma_px = 0.0, plane_sigma_m = 0.0;
};

/// Residuals of everything in the window at its present state. A few thousand of each kind, evenly taken.
ResidualSamples collectResiduals(const InertialWindow& window);

}  // namespace cocalib
