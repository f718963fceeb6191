#include "cocalib/calibrators/window_start.h"

#include <algorithm>
#include <cmath>

namespace cocalib {

void returnUnseenToPrior(const ImuBuffer& imu, Alignment* alignment) {
  InertialChain chain{ImuNoise()};
  chain.update(alignment->states, imu);
  const Eigen::Matrix3Xd unseen = LeverExcitation().unseen(alignment->states, chain).directions;
  const Eigen::Vector3d lever = alignment->T_imu_sensor.t;
  const Eigen::Vector3d shift = unseen * (unseen.transpose() * (alignment->lever_arm_guess - lever));
  alignment->T_imu_sensor.t += shift;
  for (NavState& state : alignment->states) state.T_W_I.t -= state.T_W_I.q * shift;
}

void startNodes(const Alignment& alignment, const Calibration& calibration, InertialWindow* window) {
  constexpr double kSpacing_s = 0.05;
  window->setTranslationPriors(alignment.lever_arm_prior_m, alignment.lever_arm_prior_m);
  window->reset(alignment.states.front(), calibration, alignment.gravity);
  for (std::size_t i = 0; i + 1 < alignment.states.size(); ++i) {
    const NavState& from = alignment.states[i];
    const NavState& to = alignment.states[i + 1];
    std::vector<ImuSample> samples = window->imu().slice(from.stamp, to.stamp);
    if (samples.size() < 2) continue;
    const Preintegration segment(std::move(samples), ImuNoise(), from.gyro_bias, from.accel_bias);
    const int steps = std::max(1, static_cast<int>(std::ceil(segment.duration() / kSpacing_s - 1e-3)));
    for (int k = 1; k < steps; ++k) {
      window->addNode(propagate(segment, from, alignment.gravity, from.stamp + (to.stamp - from.stamp) * k / steps));
    }
    window->addNode(to);
  }
}

}  // namespace cocalib
