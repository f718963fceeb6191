#include "cocalib/inertial/preintegration.h"

#include <algorithm>
#include <stdexcept>
#include <utility>

namespace cocalib {
namespace {

/// Advances `x` from sample `a` to rate and specific force `b` after dt, by the trapezoidal rule; an axis that turns
/// within the step adds (w_a x w_b) dt^2 / 12 to the rotation (coning). dt may be negative.
ImuIncrement step(const ImuIncrement& x, const ImuSample& a, const ImuSample& b, double dt, const Eigen::Vector3d& bg,
                  const Eigen::Vector3d& ba) {
  const Eigen::Vector3d w_a = a.gyro - bg, w_b = b.gyro - bg;
  const Eigen::Vector3d phi = 0.5 * dt * (w_a + w_b) + dt * dt / 12.0 * w_a.cross(w_b);
  const Eigen::Quaterniond dq = expSo3(phi);
  const Eigen::Vector3d f_a = a.accel - ba, f_b = b.accel - ba;
  const Eigen::Matrix3d R_a = x.q.toRotationMatrix();

  ImuIncrement y;
  y.dt_s = x.dt_s + dt;
  y.q = (x.q * dq).normalized();
  y.J_q_bg = dq.toRotationMatrix().transpose() * x.J_q_bg - rightJacobianSo3(phi) * dt;
  const Eigen::Matrix3d R_b = y.q.toRotationMatrix();
  const Eigen::Vector3d f = 0.5 * (R_a * f_a + R_b * f_b);
  const Eigen::Matrix3d J_f_bg = -0.5 * (R_a * hat(f_a) * x.J_q_bg + R_b * hat(f_b) * y.J_q_bg);
  const Eigen::Matrix3d J_f_ba = -0.5 * (R_a + R_b);
  // Specific force linear over the step: the position needs its first moment, (2 f_a + f_b) / 6.
  const Eigen::Vector3d f_p = (2.0 * (R_a * f_a) + R_b * f_b) / 3.0;
  y.v = x.v + f * dt;
  y.p = x.p + x.v * dt + 0.5 * f_p * dt * dt;
  y.J_v_bg = x.J_v_bg + J_f_bg * dt;
  y.J_v_ba = x.J_v_ba + J_f_ba * dt;
  const Eigen::Matrix3d J_fp_bg = -(2.0 * R_a * hat(f_a) * x.J_q_bg + R_b * hat(f_b) * y.J_q_bg) / 3.0;
  const Eigen::Matrix3d J_fp_ba = -(2.0 * R_a + R_b) / 3.0;
  y.J_p_bg = x.J_p_bg + x.J_v_bg * dt + 0.5 * dt * dt * J_fp_bg;
  y.J_p_ba = x.J_p_ba + x.J_v_ba * dt + 0.5 * dt * dt * J_fp_ba;
  return y;
}

ImuSample interpolate(const ImuSample& a, const ImuSample& b, TimeNs stamp) {
  const double u = toSeconds(stamp - a.stamp) / toSeconds(b.stamp - a.stamp);
  return {stamp, a.gyro + u * (b.gyro - a.gyro), a.accel + u * (b.accel - a.accel)};
}

}  // namespace

Preintegration::Preintegration(std::vector<ImuSample> samples, const ImuNoise& noise, const Eigen::Vector3d& gyro_bias,
                               const Eigen::Vector3d& accel_bias, double gap_s)
    : samples_(std::move(samples)), gyro_bias_(gyro_bias), accel_bias_(accel_bias) {
  if (samples_.size() < 2) throw std::invalid_argument("Preintegration: needs at least two samples");
  const double gyro_variance = noise.gyro_noise_density * noise.gyro_noise_density;
  const double accel_variance = noise.accel_noise_density * noise.accel_noise_density;

  increments_.reserve(samples_.size());
  increments_.emplace_back();
  for (std::size_t i = 1; i < samples_.size(); ++i) {
    const ImuSample &a = samples_[i - 1], &b = samples_[i];
    const double dt = toSeconds(b.stamp - a.stamp);
    const ImuIncrement& x = increments_.back();
    const ImuIncrement y = step(x, a, b, dt, gyro_bias_, accel_bias_);

    // Error state (p, theta right, v); white noise of density s integrates to variance s^2 dt.
    const Eigen::Matrix3d R = x.q.toRotationMatrix();
    const Eigen::Vector3d f = 0.5 * (a.accel + b.accel) - accel_bias_;
    Eigen::Matrix<double, 9, 9> F = Eigen::Matrix<double, 9, 9>::Identity();
    F.block<3, 3>(0, 3) = -0.5 * dt * dt * R * hat(f);
    F.block<3, 3>(0, 6) = dt * Eigen::Matrix3d::Identity();
    F.block<3, 3>(3, 3) = (x.q.conjugate() * y.q).toRotationMatrix().transpose();
    F.block<3, 3>(6, 3) = -dt * R * hat(f);
    covariance_ = F * covariance_ * F.transpose();
    const Eigen::Matrix3d I = Eigen::Matrix3d::Identity();
    covariance_.block<3, 3>(3, 3) += gyro_variance * dt * I;
    covariance_.block<3, 3>(6, 6) += accel_variance * dt * I;
    covariance_.block<3, 3>(0, 0) += accel_variance * dt * dt * dt / 3.0 * I;
    covariance_.block<3, 3>(0, 6) += accel_variance * dt * dt / 2.0 * I;
    covariance_.block<3, 3>(6, 0) += accel_variance * dt * dt / 2.0 * I;
    increments_.push_back(y);
  }
  if (gap_s > 0.0) addUnseenMotion(gap_s);
}

/// Between two samples the motion departs from the straight line by as much as its curvature lets it, and by no more
/// than it is lively at all.
void Preintegration::addUnseenMotion(double gap_s) {
  constexpr double kSwing = 7.5;             // rad/s: 1.2 Hz, as fast as an arm swings a rig
  constexpr double kRate = 1.0, kForce = 5;  // 1 sigma of rate [rad/s] and specific force [m/s^2]
  const double part = std::min(1.0, kSwing * kSwing * gap_s * gap_s / 8.0);
  const double span_s = std::min(gap_s, duration());
  const double turn = part * kRate * span_s, speed = part * kForce * span_s;
  covariance_.diagonal().segment<3>(0).array() += 0.25 * speed * speed * span_s * span_s;
  covariance_.diagonal().segment<3>(3).array() += turn * turn;
  covariance_.diagonal().segment<3>(6).array() += speed * speed;
}

std::size_t Preintegration::sampleBefore(TimeNs stamp) const {
  const auto after = std::upper_bound(samples_.begin(), samples_.end(), stamp,
                                      [](TimeNs t, const ImuSample& s) { return t < s.stamp; });
  const auto index = std::max<std::ptrdiff_t>(0, after - samples_.begin() - 1);
  return static_cast<std::size_t>(index);
}

ImuIncrement Preintegration::at(TimeNs stamp) const {
  const std::size_t i = sampleBefore(stamp);
  const ImuSample& a = samples_[i];
  if (stamp == a.stamp) return increments_[i];
  // Outside the segment the end samples are held: good for the few ms by which a clock offset may move a measurement.
  const bool inside = stamp > a.stamp && i + 1 < samples_.size();
  const ImuSample b = inside ? interpolate(a, samples_[i + 1], stamp) : a;
  return step(increments_[i], a, b, toSeconds(stamp - a.stamp), gyro_bias_, accel_bias_);
}

Eigen::Vector3d Preintegration::rateAt(TimeNs stamp) const {
  const std::size_t i = sampleBefore(stamp);
  if (stamp <= samples_[i].stamp || i + 1 == samples_.size()) return samples_[i].gyro;
  return interpolate(samples_[i], samples_[i + 1], stamp).gyro;
}

TimedPose timedPose(const Preintegration& segment, const NavState& start, double gravity, TimeNs stamp) {
  const ImuIncrement d = segment.at(stamp);
  const Eigen::Vector3d dbg = start.gyro_bias - segment.gyroBias();
  const Eigen::Vector3d dba = start.accel_bias - segment.accelBias();
  const Eigen::Vector3d phi = d.J_q_bg * dbg;
  const Eigen::Vector3d dp = d.p + d.J_p_bg * dbg + d.J_p_ba * dba;
  const Eigen::Vector3d dv = d.v + d.J_v_bg * dbg + d.J_v_ba * dba;
  const Eigen::Matrix3d R_k = start.T_W_I.R();
  const double dt = d.dt_s;
  const Eigen::Vector3d g_W(0.0, 0.0, -gravity);

  TimedPose out;
  out.T_W_I.q = (start.T_W_I.q * d.q * expSo3(phi)).normalized();
  const Eigen::Vector3d R_dp = R_k * dp;
  out.T_W_I.t = start.T_W_I.t + start.v_W * dt + 0.5 * dt * dt * g_W + R_dp;
  out.v_W = start.v_W + dt * g_W + R_k * dv;
  out.w_I = segment.rateAt(stamp) - start.gyro_bias;
  const Eigen::Matrix3d R_t = out.T_W_I.R();

  out.J_state.setZero();
  out.J_state.block<3, 3>(0, 0).setIdentity();
  out.J_state.block<3, 3>(0, 3) = -hat(R_dp);
  out.J_state.block<3, 3>(0, 6) = dt * Eigen::Matrix3d::Identity();
  out.J_state.block<3, 3>(0, 9) = R_k * d.J_p_bg;
  out.J_state.block<3, 3>(0, 12) = R_k * d.J_p_ba;
  out.J_state.block<3, 3>(3, 3).setIdentity();
  out.J_state.block<3, 3>(3, 9) = R_t * rightJacobianSo3(phi) * d.J_q_bg;
  out.J_gravity << 0.0, 0.0, -0.5 * dt * dt, 0.0, 0.0, 0.0;
  out.J_time << out.v_W, R_t * out.w_I;
  return out;
}

NavState propagate(const Preintegration& segment, const NavState& start, double gravity, TimeNs stamp) {
  const TimedPose pose = timedPose(segment, start, gravity, stamp);
  NavState state = start;
  state.stamp = stamp;
  state.T_W_I = pose.T_W_I;
  state.v_W = pose.v_W;
  return state;
}

}  // namespace cocalib
