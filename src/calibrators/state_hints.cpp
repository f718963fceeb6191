#include "cocalib/calibrators/state_hints.h"

#include <algorithm>
#include <iterator>

#include "cocalib/inertial/preintegration.h"

namespace cocalib {

void StateHints::add(const std::optional<NavState>& state) {
  if (state && (states_.empty() || state->stamp > states_.back().stamp)) states_.push_back(*state);
}

NavState StateHints::at(TimeNs stamp, const ImuBuffer& imu, double gravity) const {
  const auto after =
      std::upper_bound(states_.begin(), states_.end(), stamp, [](TimeNs t, const NavState& s) { return t < s.stamp; });
  const NavState& hint = after == states_.begin() ? states_.front() : *std::prev(after);
  std::vector<ImuSample> samples = imu.slice(hint.stamp, stamp);
  if (samples.size() < 2) return hint;
  const Preintegration segment(std::move(samples), ImuNoise(), hint.gyro_bias, hint.accel_bias);
  return propagate(segment, hint, gravity, stamp);
}

void StateHints::forgetBefore(TimeNs stamp) {
  while (states_.size() > 1 && states_[1].stamp <= stamp) states_.pop_front();
}

Pose alignWorlds(const NavState& in_a, const NavState& in_b) {
  const Eigen::Quaterniond turn = in_a.T_W_I.q * in_b.T_W_I.q.conjugate();
  Pose T_A_B;
  T_A_B.q = Eigen::Quaterniond(turn.w(), 0.0, 0.0, turn.z()).normalized();
  T_A_B.t = in_a.T_W_I.t - T_A_B.q * in_b.T_W_I.t;
  return T_A_B;
}

}  // namespace cocalib
