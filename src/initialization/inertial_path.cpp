#include "cocalib/initialization/inertial_path.h"

#include <algorithm>

#include "cocalib/geometry/so3.h"

namespace cocalib {
namespace {

/// One step between two samples whose biases are removed.
InertialIncrement step(const InertialIncrement& from, const ImuSample& a, const ImuSample& b) {
  const double dt = toSeconds(b.stamp - a.stamp);
  const Eigen::Vector3d angle = 0.5 * dt * (a.gyro + b.gyro);
  const Eigen::Quaterniond turn = expSo3(angle);
  InertialIncrement to;
  to.time_s = from.time_s + dt;
  to.rate = b.gyro;
  to.R_0_t = (from.R_0_t * turn).normalized();
  to.R_bg = turn.conjugate().toRotationMatrix() * from.R_bg - dt * rightJacobianSo3(angle);

  const Eigen::Matrix3d R_a = from.R_0_t.toRotationMatrix();
  const Eigen::Matrix3d R_b = to.R_0_t.toRotationMatrix();
  const Eigen::Vector3d f_a = R_a * a.accel;
  const Eigen::Vector3d f_b = R_b * b.accel;
  const Eigen::Matrix3d f_a_bg = -R_a * hat(a.accel) * from.R_bg;
  const Eigen::Matrix3d f_b_bg = -R_b * hat(b.accel) * to.R_bg;
  // Specific force linear between the samples: its first and second integrals weigh the ends 1/2, 1/2 and 1/3, 1/6.
  const double h = 0.5 * dt, h_a = dt * dt / 3.0, h_b = dt * dt / 6.0;
  to.v = from.v + h * (f_a + f_b);
  to.p = from.p + dt * from.v + h_a * f_a + h_b * f_b;
  to.v_ba = from.v_ba - h * (R_a + R_b);
  to.p_ba = from.p_ba + dt * from.v_ba - h_a * R_a - h_b * R_b;
  to.v_bg = from.v_bg + h * (f_a_bg + f_b_bg);
  to.p_bg = from.p_bg + dt * from.v_bg + h_a * f_a_bg + h_b * f_b_bg;
  return to;
}

}  // namespace

std::optional<InertialPath> InertialPath::integrate(const ImuBuffer& imu, TimeNs from, TimeNs to,
                                                    const Eigen::Vector3d& gyro_bias,
                                                    const Eigen::Vector3d& accel_bias) {
  InertialPath path;
  path.samples_ = imu.slice(from, to);
  if (path.samples_.empty()) return std::nullopt;
  for (ImuSample& sample : path.samples_) {
    sample.gyro -= gyro_bias;
    sample.accel -= accel_bias;
  }
  path.increments_.resize(path.samples_.size());
  path.increments_.front().rate = path.samples_.front().gyro;
  for (std::size_t i = 1; i < path.samples_.size(); ++i) {
    path.increments_[i] = step(path.increments_[i - 1], path.samples_[i - 1], path.samples_[i]);
  }
  return path;
}

std::size_t InertialPath::nodeBefore(TimeNs stamp) const {
  const auto after = std::upper_bound(samples_.begin(), samples_.end(), stamp,
                                      [](TimeNs t, const ImuSample& sample) { return t < sample.stamp; });
  return after == samples_.begin() ? 0 : static_cast<std::size_t>(after - samples_.begin()) - 1;
}

ImuSample InertialPath::sampleAt(std::size_t node, TimeNs stamp) const {
  const ImuSample& a = samples_[node];
  if (stamp < a.stamp || node + 1 == samples_.size()) return {stamp, a.gyro, a.accel};
  const ImuSample& b = samples_[node + 1];
  const double s = toSeconds(stamp - a.stamp) / toSeconds(b.stamp - a.stamp);
  return {stamp, a.gyro + s * (b.gyro - a.gyro), a.accel + s * (b.accel - a.accel)};
}

InertialIncrement InertialPath::at(TimeNs stamp) const {
  const std::size_t node = nodeBefore(stamp);
  if (samples_[node].stamp == stamp) return increments_[node];
  return step(increments_[node], samples_[node], sampleAt(node, stamp));
}

Eigen::Quaterniond InertialPath::rotationAt(TimeNs stamp) const {
  const std::size_t node = nodeBefore(stamp);
  const double dt = toSeconds(stamp - samples_[node].stamp);
  const ImuSample sample = sampleAt(node, stamp);
  return increments_[node].R_0_t * expSo3(0.5 * dt * (samples_[node].gyro + sample.gyro));
}

}  // namespace cocalib
