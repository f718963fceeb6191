#include "cocalib/calibrators/state_hints.h"

#include <algorithm>
#include <iterator>
#include <utility>
#include <vector>

#include "cocalib/inertial/preintegration.h"

namespace cocalib {
namespace {

// Two states of one world, some hundredths of a second apart, never disagree by so much; those of a calibrator that has
// started anew do, as a rule.
constexpr double kOtherWorld_m = 0.3, kOtherWorld_rad = 0.1;

/// Takes the world of `hint` to that of `state`, both at one time: a turn about the vertical and a shift.
Pose alignWorlds(const NavState& state, const NavState& hint) {
  const Eigen::Quaterniond turn = state.T_W_I.q * hint.T_W_I.q.conjugate();
  Pose T;
  T.q = Eigen::Quaterniond(turn.w(), 0.0, 0.0, turn.z()).normalized();
  T.t = state.T_W_I.t - T.q * hint.T_W_I.t;
  return T;
}

}  // namespace

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
  T_window_hint_ = alignWorlds(node, hints.at(node.stamp, window->imu(), window->state().gravity));
}

void HintedNodes::addNodeAt(TimeNs stamp) {
  const NavState& last = window_->state().nodes.back();
  if (stamp <= last.stamp) return;
  const NavState hint = hints_.at(stamp, window_->imu(), window_->state().gravity);
  if (hint.stamp != stamp) return;  // no inertial data there
  const Vector6d jump = (T_window_hint_ * hint.T_W_I).minus(carriedOn(last, stamp).T_W_I);
  if (jump.head<3>().norm() > kOtherWorld_m || jump.tail<3>().norm() > kOtherWorld_rad) {
    T_window_hint_ = alignWorlds(carriedOn(last, stamp), hint);
  }
  NavState node = hint;
  node.T_W_I = T_window_hint_ * hint.T_W_I;
  node.v_W = T_window_hint_.q * hint.v_W;
  node.gyro_bias = last.gyro_bias;
  node.accel_bias = last.accel_bias;
  window_->addNode(node);
}

NavState HintedNodes::carriedOn(const NavState& node, TimeNs stamp) const {
  std::vector<ImuSample> samples = window_->imu().slice(node.stamp, stamp);
  if (samples.size() < 2) return node;
  const Preintegration segment(std::move(samples), ImuNoise(), node.gyro_bias, node.accel_bias);
  return propagate(segment, node, window_->state().gravity, stamp);
}

void HintedNodes::fillTo(TimeNs stamp) {
  constexpr TimeNs kSpacing = 50000000;
  const TimeNs from = window_->state().nodes.back().stamp;
  const auto steps = static_cast<int>((stamp - from + kSpacing / 2) / kSpacing);
  for (int i = 1; i <= steps; ++i) addNodeAt(from + (stamp - from) * i / std::max(steps, 1));
  addNodeAt(stamp);
}

}  // namespace cocalib
