#pragma once

#include <vector>

#include "cocalib/initialization/lidar_camera_initializer.h"

namespace cocalib {

/// The same plate as both sensors see it: camera's pose, lidar's patch.
struct PlatePair {
  Pose T_C_P;  ///< plate in the camera: origin in its middle, axes of B
  const LidarPlate* plate;

  Eigen::Vector3d normal_C() const { return T_C_P.q * Eigen::Vector3d::UnitZ(); }
};

/// Rotation from aligned normals (or, where `use_centres`, normals and lines between middles), then translation from
/// plane offsets and middles. @pre at least 2 pairs
Pose alignPlates(const std::vector<PlatePair>& pairs, bool use_centres);

/// Result of the refinement.
struct PlateFit {
  Pose T_L_C;
  double range_bias_m = 0.0;
  double plane_rms_m = 0.0, edge_rms_m = 0.0;
};

/// Least squares of all points' distances to the camera's plates and of all crossings' distances to their outlines.
PlateFit refinePlates(const std::vector<PlatePair>& pairs, const Eigen::Vector2d& plate_size_m, const Pose& start_T_L_C,
                      const LidarCameraInitializerParams& params);

}  // namespace cocalib
