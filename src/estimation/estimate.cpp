#include "cocalib/estimation/estimate.h"

namespace cocalib {

const char* toString(Status status) {
  switch (status) {
    case Status::kUnobservable:
      return "unobservable";
    case Status::kConverging:
      return "converging";
    case Status::kConverged:
      return "converged";
    case Status::kInsufficientData:
      break;
  }
  return "insufficient_data";
}

// With R = R_I_L and d = t_I_C - t_I_L: t_L_C = R' d and R_L_C = R' R_I_C. Under the tangents of both poses
//   d t_L_C = R' (dt_C - dt_L) + R' hat(d) dtheta_L,   dtheta = R' (dtheta_C - dtheta_L).
Matrix6d lidarCameraCovariance(const Calibration& calibration, const Matrix14d& covariance) {
  const Eigen::Matrix3d R_L_I = calibration.T_imu_lidar.R().transpose();
  const Eigen::Vector3d d_I = calibration.T_imu_camera.t - calibration.T_imu_lidar.t;
  Eigen::Matrix<double, 6, 12> J = Eigen::Matrix<double, 6, 12>::Zero();
  J.block<3, 3>(0, 0) = R_L_I;
  J.block<3, 3>(0, 6) = -R_L_I;
  J.block<3, 3>(0, 9) = R_L_I * hat(d_I);
  J.block<3, 3>(3, 3) = R_L_I;
  J.block<3, 3>(3, 9) = -R_L_I;
  const Matrix6d result = J * covariance.topLeftCorner<12, 12>() * J.transpose();
  return 0.5 * (result + result.transpose());
}

}  // namespace cocalib
