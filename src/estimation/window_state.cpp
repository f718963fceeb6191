#include "cocalib/estimation/window_state.h"

#include <algorithm>
#include <cmath>

namespace cocalib {

WindowState WindowState::plus(const ChainSystem::Step& step) const {
  using Layout = GlobalLayout;
  const Eigen::VectorXd& d = step.globals;
  WindowState out = *this;
  for (std::size_t i = 0; i < nodes.size(); ++i) out.nodes[i] = cocalib::plus(nodes[i], step.nodes[i]);
  out.gravity += d[Layout::kGravity];
  out.calibration.T_imu_camera = calibration.T_imu_camera.plus(d.segment<6>(Layout::kCamera));
  out.calibration.camera_time_offset_s += d[Layout::kCameraOffset];
  out.calibration.T_imu_lidar = calibration.T_imu_lidar.plus(d.segment<6>(Layout::kLidar));
  out.calibration.lidar_time_offset_s += d[Layout::kLidarOffset];
  out.T_W_B = T_W_B.plus(d.segment<6>(Layout::kBoard));
  out.outline += d.segment<4>(Layout::kOutline);
  for (std::size_t i = 0; i < planes.size(); ++i) {
    out.planes[i] = cocalib::plus(planes[i], d.segment<3>(Layout::plane(static_cast<int>(i))));
  }
  return out;
}

Eigen::VectorXd globalMinus(const WindowState& state, const WindowState& base) {
  using Layout = GlobalLayout;
  const std::size_t planes = std::min(state.planes.size(), base.planes.size());
  Eigen::VectorXd d = Eigen::VectorXd::Zero(Layout::size(static_cast<int>(state.planes.size())));
  d[Layout::kGravity] = state.gravity - base.gravity;
  d.segment<6>(Layout::kCamera) = state.calibration.T_imu_camera.minus(base.calibration.T_imu_camera);
  d[Layout::kCameraOffset] = state.calibration.camera_time_offset_s - base.calibration.camera_time_offset_s;
  d.segment<6>(Layout::kLidar) = state.calibration.T_imu_lidar.minus(base.calibration.T_imu_lidar);
  d[Layout::kLidarOffset] = state.calibration.lidar_time_offset_s - base.calibration.lidar_time_offset_s;
  d.segment<6>(Layout::kBoard) = state.T_W_B.minus(base.T_W_B);
  d.segment<4>(Layout::kOutline) = state.outline - base.outline;
  for (std::size_t i = 0; i < planes; ++i) {
    d.segment<3>(Layout::plane(static_cast<int>(i))) = minus(state.planes[i], base.planes[i]);
  }
  return d;
}

}  // namespace cocalib
