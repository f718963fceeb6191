#include "cocalib/factors/imu_factor.h"

#include <Eigen/Cholesky>
#include <cmath>

namespace cocalib {

NavState plus(const NavState& state, const Vector15d& delta) {
  NavState out = state;
  out.T_W_I = state.T_W_I.plus(delta.head<6>());
  out.v_W += delta.segment<3>(6);
  out.gyro_bias += delta.segment<3>(9);
  out.accel_bias += delta.segment<3>(12);
  return out;
}

Vector15d minus(const NavState& state, const NavState& base) {
  Vector15d delta;
  delta << state.T_W_I.minus(base.T_W_I), state.v_W - base.v_W, state.gyro_bias - base.gyro_bias,
      state.accel_bias - base.accel_bias;
  return delta;
}

ImuFactor::ImuFactor(const Preintegration& segment, const ImuNoise& noise) : segment_(&segment) {
  // A floor far below any sensor keeps the matrix regular for segments of a single sample interval.
  Eigen::Matrix<double, 9, 9> covariance = segment.covariance();
  covariance.diagonal().head<3>().array() += 1e-14;
  covariance.diagonal().segment<3>(3).array() += 1e-16;
  covariance.diagonal().tail<3>().array() += 1e-14;
  const Eigen::Matrix<double, 9, 9> information = covariance.llt().solve(Eigen::Matrix<double, 9, 9>::Identity());

  sqrt_information_.setZero();
  sqrt_information_.topLeftCorner<9, 9>() = Eigen::Matrix<double, 9, 9>(information.llt().matrixU());
  const double root_dt = std::sqrt(segment.duration());
  sqrt_information_.diagonal().segment<3>(9).setConstant(1.0 / (noise.gyro_bias_walk * root_dt));
  sqrt_information_.diagonal().segment<3>(12).setConstant(1.0 / (noise.accel_bias_walk * root_dt));
}

ImuResidual ImuFactor::evaluate(const NavState& state_i, const NavState& state_j, double gravity) const {
  const ImuIncrement& d = segment_->atEnd();
  const double dt = d.dt_s;
  const Eigen::Vector3d dbg = state_i.gyro_bias - segment_->gyroBias();
  const Eigen::Vector3d dba = state_i.accel_bias - segment_->accelBias();
  const Eigen::Vector3d phi = d.J_q_bg * dbg;
  const Eigen::Vector3d g_W(0.0, 0.0, -gravity);
  const Eigen::Matrix3d R_i_t = state_i.T_W_I.R().transpose();
  const Eigen::Matrix3d R_j_t = state_j.T_W_I.R().transpose();

  const Eigen::Vector3d p_W = state_j.T_W_I.t - state_i.T_W_I.t - state_i.v_W * dt - 0.5 * dt * dt * g_W;
  const Eigen::Vector3d v_W = state_j.v_W - state_i.v_W - dt * g_W;
  const Eigen::Quaterniond dq = d.q * expSo3(phi);
  const Eigen::Vector3d r_q = logSo3(dq.conjugate() * state_i.T_W_I.q.conjugate() * state_j.T_W_I.q);

  ImuResidual out;
  out.r.segment<3>(0) = R_i_t * p_W - (d.p + d.J_p_bg * dbg + d.J_p_ba * dba);
  out.r.segment<3>(3) = r_q;
  out.r.segment<3>(6) = R_i_t * v_W - (d.v + d.J_v_bg * dbg + d.J_v_ba * dba);
  out.r.segment<3>(9) = state_j.gyro_bias - state_i.gyro_bias;
  out.r.segment<3>(12) = state_j.accel_bias - state_i.accel_bias;

  const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
  out.J_i.setZero();
  out.J_j.setZero();
  // R_i <- Exp(e) R_i gives R_i^T a -> R_i^T a - R_i^T (e x a) = R_i^T a + R_i^T hat(a) e.
  out.J_i.block<3, 3>(0, 0) = -R_i_t;
  out.J_i.block<3, 3>(0, 3) = R_i_t * hat(p_W);
  out.J_i.block<3, 3>(0, 6) = -dt * R_i_t;
  out.J_i.block<3, 3>(0, 9) = -d.J_p_bg;
  out.J_i.block<3, 3>(0, 12) = -d.J_p_ba;
  out.J_j.block<3, 3>(0, 0) = R_i_t;

  const Eigen::Matrix3d J_r_inverse = inverseLeftJacobianSo3(r_q).transpose();
  out.J_j.block<3, 3>(3, 3) = J_r_inverse * R_j_t;
  out.J_i.block<3, 3>(3, 3) = -J_r_inverse * R_j_t;
  out.J_i.block<3, 3>(3, 9) = -inverseLeftJacobianSo3(r_q) * rightJacobianSo3(phi) * d.J_q_bg;

  out.J_i.block<3, 3>(6, 3) = R_i_t * hat(v_W);
  out.J_i.block<3, 3>(6, 6) = -R_i_t;
  out.J_i.block<3, 3>(6, 9) = -d.J_v_bg;
  out.J_i.block<3, 3>(6, 12) = -d.J_v_ba;
  out.J_j.block<3, 3>(6, 6) = R_i_t;

  out.J_i.block<6, 6>(9, 9) = -Eigen::Matrix<double, 6, 6>::Identity();
  out.J_j.block<6, 6>(9, 9).setIdentity();

  out.J_gravity.setZero();
  out.J_gravity.segment<3>(0) = 0.5 * dt * dt * R_i_t * I.col(2);
  out.J_gravity.segment<3>(6) = dt * R_i_t * I.col(2);

  out.r = sqrt_information_ * out.r;
  out.J_i = sqrt_information_ * out.J_i;
  out.J_j = sqrt_information_ * out.J_j;
  out.J_gravity = sqrt_information_ * out.J_gravity;
  return out;
}

}  // namespace cocalib
