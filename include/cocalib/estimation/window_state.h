#pragma once

#include <Eigen/Core>
#include <vector>

#include "cocalib/estimation/chain_system.h"
#include "cocalib/estimation/estimate.h"
#include "cocalib/geometry/plane.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Columns of the globals in a ChainSystem. Each sensor's offset follows its pose, so both are one block of seven.
struct GlobalLayout {
  static constexpr int kGravity = 0;
  static constexpr int kCamera = 1;  ///< T_imu_camera, 6
  static constexpr int kCameraOffset = 7;
  static constexpr int kLidar = 8;  ///< T_imu_lidar, 6
  static constexpr int kLidarOffset = 14;
  static constexpr int kBoard = 15;    ///< T_W_B, 6
  static constexpr int kOutline = 21;  ///< edges of the plate in B: x_min, x_max, y_min, y_max
  static constexpr int kFixed = 25;
  static int plane(int index) { return kFixed + 3 * index; }
  static int size(int planes) { return kFixed + 3 * planes; }
  /// Column of entry i of the published covariance (camera t, r, lidar t, r, camera offset, lidar offset).
  static int calibrationColumn(int i) {
    return i < 6 ? kCamera + i : i < 12 ? kLidar + i - 6 : i == 12 ? kCameraOffset : kLidarOffset;
  }
};

/// Everything a window estimates.
struct WindowState {
  std::vector<NavState> nodes;
  Calibration calibration;
  double gravity = 9.80665;  ///< magnitude [m/s^2]
  Pose T_W_B;
  Eigen::Vector4d outline = Eigen::Vector4d::Zero();  ///< plate in B: x_min, x_max, y_min, y_max [m]
  std::vector<Plane> planes;                          ///< in W

  WindowState plus(const ChainSystem::Step& step) const;
};

/// Tangent of the globals that leads from `base` to `state` (planes: those that both have).
Eigen::VectorXd globalMinus(const WindowState& state, const WindowState& base);

}  // namespace cocalib
