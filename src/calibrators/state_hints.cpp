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

HintedNodes::HintedNodes(const StateHints& hints, InertialWindow* window) : hints_(hints), window_(window) {
  const NavState& node = window->state().nodes.back();
  const NavState hint = hints.at(node.stamp, window->imu(), window->state().gravity);
  const Eigen::Quaterniond turn = node.T_W_I.q * hint.T_W_I.q.conjugate();
  T_window_hint_.q = Eigen::Quaterniond(turn.w(), 0.0, 0.0, turn.z()).normalized();
  T_window_hint_.t = node.T_W_I.t - T_window_hint_.q * hint.T_W_I.t;
}

void HintedNodes::addNodeAt(TimeNs stamp) {
  const NavState& last = window_->state().nodes.back();
  if (stamp <= last.stamp) return;
  NavState node = hints_.at(stamp, window_->imu(), window_->state().gravity);
  if (node.stamp != stamp) return;  // no inertial data there
  node.T_W_I = T_window_hint_ * node.T_W_I;
  node.v_W = T_window_hint_.q * node.v_W;
  node.gyro_bias = last.gyro_bias;
  node.accel_bias = last.accel_bias;
  window_->addNode(node);
}

void HintedNodes::fillTo(TimeNs stamp) {
  constexpr TimeNs kSpacing = 50000000;
  const TimeNs from = window_->state().nodes.back().stamp;
  const auto steps = static_cast<int>((stamp - from + kSpacing / 2) / kSpacing);
  for (int i = 1; i <= steps; ++i) addNodeAt(from + (stamp - from) * i / std::max(steps, 1));
  addNodeAt(stamp);
}

}  // namespace cocalib
