#include "cocalib/estimation/calibration_prior.h"

namespace cocalib {

CalibrationPrior priorFrom(const CalibrationEstimate& earlier) {
  const WindowPriors unknown;
  CalibrationPrior prior;
  prior.mean = earlier.calibration;
  Vector14d sigma;
  sigma << Eigen::Vector3d::Constant(unknown.camera_translation_m),
      Eigen::Vector3d::Constant(unknown.extrinsic_rotation_rad),
      Eigen::Vector3d::Constant(unknown.lidar_translation_m),
      Eigen::Vector3d::Constant(unknown.extrinsic_rotation_rad), unknown.time_offset_s, unknown.time_offset_s;
  prior.covariance = sigma.cwiseAbs2().asDiagonal();
  const auto isKnown = [&earlier](int i) { return i < 6 || i == 12 ? earlier.camera.valid : earlier.lidar.valid; };
  for (int i = 0; i < 14; ++i) {
    for (int j = 0; j < 14; ++j) {
      if (isKnown(i) && isKnown(j)) prior.covariance(i, j) = earlier.covariance(i, j);
    }
  }
  return prior;
}

}  // namespace cocalib
