#include "fuser_window.h"

#include <Eigen/Cholesky>

namespace cocalib {

InertialWindow::Params fuserWindowParams(const FuserParams& params, const ImuNoise& noise, const FuserInputs& inputs) {
  InertialWindow::Params window;
  window.imu_noise = noise;
  if (inputs.camera) {
    CameraGroup::Params camera(*inputs.camera);
    camera.board = inputs.board;
    camera.corner_sigma_px = params.corner_sigma_px;
    camera.track_noise.sigma_px = params.track_sigma_px;
    window.camera = camera;
  }
  if (inputs.lidar) {
    LidarGroup::Params lidar;
    lidar.range_noise_m = params.range_noise_m;
    if (inputs.camera) lidar.board = inputs.board;
    window.lidar = lidar;
    window.plane_map.point_sigma_m = params.range_noise_m;
  }
  return window;
}

std::optional<CalibrationPrior> knowledge(const CalibrationEstimate& estimate) {
  if (!estimate.camera.valid && !estimate.lidar.valid) return std::nullopt;
  const CalibrationPrior prior = priorFrom(estimate);
  if (!prior.covariance.allFinite() || prior.covariance.llt().info() != Eigen::Success) return std::nullopt;
  return prior;
}

}  // namespace cocalib
