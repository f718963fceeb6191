#include "cocalib/sim/trajectory.h"

#include <algorithm>
#include <cmath>

#include "cocalib/sim/drive.h"
#include "cocalib/sim/random.h"
#include "cocalib/sim/scene.h"

namespace cocalib::sim {
namespace {

constexpr double kTwoPi = 6.283185307179586;

struct Term {
  double amplitude, frequency_hz, phase;  // [m] or [rad]
};
using AxisTable = std::array<std::vector<Term>, 6>;  // x y z roll pitch yaw

const AxisTable& fullTable() {
  static const AxisTable table = {{{{0.50, 0.17, 0.3}, {0.12, 0.53, 1.1}, {0.045, 1.03, 2.0}},
                                   {{0.55, 0.13, 1.7}, {0.13, 0.61, 0.4}, {0.045, 0.97, 0.9}},
                                   {{0.30, 0.19, 0.9}, {0.10, 0.67, 2.6}, {0.035, 1.11, 1.4}},
                                   {{0.25, 0.23, 0.2}, {0.17, 0.59, 1.9}, {0.06, 1.07, 0.5}},
                                   {{0.24, 0.29, 1.2}, {0.15, 0.71, 0.1}, {0.05, 1.13, 2.2}},
                                   {{0.38, 0.11, 2.1}, {0.22, 0.47, 0.6}, {0.08, 1.01, 1.0}}}};
  return table;
}

const AxisTable& mildTable() {
  static const AxisTable table = {{{{0.50, 0.07, 0.3}, {0.12, 0.27, 1.1}},
                                   {{0.55, 0.06, 1.7}, {0.10, 0.31, 0.4}},
                                   {{0.30, 0.09, 0.9}, {0.08, 0.29, 2.6}},
                                   {{0.12, 0.11, 0.2}, {0.05, 0.29, 1.9}},
                                   {{0.10, 0.13, 1.2}, {0.04, 0.31, 0.1}},
                                   {{0.25, 0.06, 2.1}, {0.06, 0.27, 0.6}}}};
  return table;
}

// Which of x y z roll pitch yaw a motion moves.
std::array<bool, 6> movedAxes(Motion motion) {
  switch (motion) {
    case Motion::kPlanar:
      return {true, true, false, false, false, true};
    case Motion::kUpright:
      return {true, true, true, false, false, true};
    case Motion::kRotationOnly:
      return {false, false, false, true, true, true};
    case Motion::kTranslationOnly:
      return {true, true, true, false, false, false};
    case Motion::kStatic:
      return {false, false, false, false, false, false};
    default:
      return {true, true, true, true, true, true};
  }
}

}  // namespace

Trajectory::Trajectory(const Scenario& scenario)
    : epoch_(scenario.epoch),
      ramp_s_(scenario.ramp_s),
      planar_for_s_(scenario.planar_for_s),
      parked_after_s_(scenario.parked_after_s),
      driven_(scenario.place == Place::kBuilding) {
  const AxisTable& table = scenario.motion == Motion::kMild ? mildTable() : fullTable();
  const std::array<bool, 6> moved = movedAxes(scenario.motion);
  Random random(scenario.seed, Random::Stream::kMotion);
  for (int i = 0; i < 6; ++i) {
    for (const Term& term : table[i]) {
      const double drawn = random.uniform(0.0, kTwoPi);
      const double phase = scenario.seed == 1 ? term.phase : drawn;
      if (moved[i]) sinusoids_[i].push_back({term.amplitude, kTwoPi * term.frequency_hz, phase});
    }
  }
}

Eigen::Vector3d Trajectory::ramp(double t) const {
  if (t <= 0.0) return Eigen::Vector3d::Zero();
  if (t >= ramp_s_) return Eigen::Vector3d::UnitX();
  // The polynomial of degree 9 with four vanishing derivatives at both ends: jerk and snap stay continuous.
  const double u = t / ramp_s_;
  const double u3 = u * u * u;
  const double value = u3 * u * u * (126.0 + u * (-420.0 + u * (540.0 + u * (-315.0 + u * 70.0))));
  const double q = u * (1.0 - u);
  const double first = 630.0 * q * q * q * q;
  const double second = 2520.0 * q * q * q * (1.0 - 2.0 * u);
  return {value, first / ramp_s_, second / (ramp_s_ * ramp_s_)};
}

Eigen::Vector3d Trajectory::fade(double t, const Eigen::Vector3d& swell) const {
  if (parked_after_s_ <= 0.0) return swell;
  const Eigen::Vector3d left = Eigen::Vector3d::UnitX() - ramp(t - parked_after_s_);
  return {left[0] * swell[0], left[1] * swell[0] + left[0] * swell[1],
          left[2] * swell[0] + 2.0 * left[1] * swell[1] + left[0] * swell[2]};
}

Eigen::Vector3d Trajectory::axis(int index, double t, const Eigen::Vector3d& ramp, int derivatives) const {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Sinusoid& s : sinusoids_[index]) {
    const double angle = s.omega * t + s.phase;
    const double sine = std::sin(angle);
    sum[0] += s.amplitude * sine;
    if (derivatives == 0) continue;
    sum[1] += s.amplitude * s.omega * std::cos(angle);
    sum[2] -= s.amplitude * s.omega * s.omega * sine;
  }
  return {ramp[0] * sum[0], ramp[1] * sum[0] + ramp[0] * sum[1],
          ramp[2] * sum[0] + 2.0 * ramp[1] * sum[1] + ramp[0] * sum[2]};
}

void Trajectory::addDrive(double t, const Eigen::Vector3d& ramp, Axes* axes) const {
  if (!driven_ || t <= 0.0) return;
  // The speed along the way swells with the ramp, so the way is its integral.
  const double u = std::min(t / ramp_s_, 1.0);
  const double u6 = u * u * u * u * u * u;
  const double swollen_s = ramp_s_ * u6 * (21.0 + u * (-60.0 + u * (67.5 + u * (-35.0 + u * 7.0))));
  const double angle = drive::kRate * (swollen_s + std::max(0.0, t - ramp_s_));
  const double rate = drive::kRate * ramp[0], acceleration = drive::kRate * ramp[1];
  const drive::Point way = drive::at(angle);
  for (int i = 0; i < 2; ++i) {
    (*axes)[static_cast<std::size_t>(i)] +=
        Eigen::Vector3d(way.p[i], way.dp[i] * rate, way.ddp[i] * rate * rate + way.dp[i] * acceleration);
  }
  axes->back() += Eigen::Vector3d(angle, rate, acceleration);
}

Trajectory::Axes Trajectory::axes(double t, int derivatives) const {
  const Eigen::Vector3d swell = fade(t, ramp(t)), late_swell = fade(t, ramp(t - planar_for_s_));
  Axes axes;
  for (int i = 0; i < 6; ++i) {
    const bool planar = i < 2 || i == 5;
    axes[static_cast<std::size_t>(i)] = axis(i, t, planar ? swell : late_swell, derivatives);
  }
  addDrive(t, swell, &axes);
  return axes;
}

Pose Trajectory::T_W_I(double t) const {
  const Axes axes = this->axes(t, 0);
  const Eigen::Quaterniond q(rotationFromRpy({axes[3][0], axes[4][0], axes[5][0]}));
  return {q, restPosition() + Eigen::Vector3d(axes[0][0], axes[1][0], axes[2][0])};
}

Trajectory::Kinematics Trajectory::at(double t) const {
  const Axes axes = this->axes(t, 2);
  Kinematics k;
  const double roll = axes[3][0], pitch = axes[4][0];
  const double roll_rate = axes[3][1], pitch_rate = axes[4][1], yaw_rate = axes[5][1];
  k.T_W_I.q = Eigen::Quaterniond(rotationFromRpy({roll, pitch, axes[5][0]}));
  k.T_W_I.t = restPosition() + Eigen::Vector3d(axes[0][0], axes[1][0], axes[2][0]);
  k.v_W = {axes[0][1], axes[1][1], axes[2][1]};
  k.a_W = {axes[0][2], axes[1][2], axes[2][2]};
  k.omega_I = {roll_rate - yaw_rate * std::sin(pitch),
               pitch_rate * std::cos(roll) + yaw_rate * std::sin(roll) * std::cos(pitch),
               -pitch_rate * std::sin(roll) + yaw_rate * std::cos(roll) * std::cos(pitch)};
  return k;
}

NavState Trajectory::stateAt(TimeNs stamp) const {
  const Kinematics k = at(timeOf(stamp));
  NavState state;
  state.stamp = stamp;
  state.T_W_I = k.T_W_I;
  state.v_W = k.v_W;
  return state;
}

}  // namespace cocalib::sim
