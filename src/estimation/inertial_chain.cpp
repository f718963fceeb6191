#include "cocalib/estimation/inertial_chain.h"

#include <algorithm>
#include <cmath>

namespace cocalib {
namespace {

// First-order bias correction is good to second order in the change; these keep its error under the sensor's noise.
constexpr double kMaxGyroBiasChange = 2e-3;   // rad/s
constexpr double kMaxAccelBiasChange = 2e-2;  // m/s^2

constexpr double kLongestSpacing_s = 0.03;  // of samples: 50 Hz, the slowest IMU that is accepted, with jitter
constexpr double kTailSeconds = 0.2;        // how far the last segment reaches where samples are there

bool isFar(const Preintegration& segment, const NavState& node) {
  return (segment.gyroBias() - node.gyro_bias).norm() > kMaxGyroBiasChange ||
         (segment.accelBias() - node.accel_bias).norm() > kMaxAccelBiasChange;
}

}  // namespace

void InertialChain::update(const std::vector<NavState>& nodes, const ImuBuffer& imu) {
  segments_.resize(nodes.size());
  for (std::size_t k = 0; k < nodes.size(); ++k) {
    const bool last = k + 1 == nodes.size();
    const TimeNs from = nodes[k].stamp;
    const TimeNs to = last ? std::min(from + toNs(kTailSeconds), imu.lastStamp()) : nodes[k + 1].stamp;
    auto& segment = segments_[k];
    if (segment && segment->start() == from && segment->end() == to && !isFar(*segment, nodes[k])) continue;
    std::vector<ImuSample> samples = imu.sliceForIntegration(from, to);
    if (samples.size() < 2) {
      // At the very end of the data: hold the last sample for a millisecond.
      samples = {*imu.at(from), *imu.at(from)};
      samples.back().stamp += toNs(1e-3);
    }
    const double longest_s = imu.longestGap(from, to);
    const bool gap = std::isfinite(longest_s) && longest_s > kLongestSpacing_s;
    segment = std::make_shared<const Preintegration>(std::move(samples), noise_, nodes[k].gyro_bias,
                                                     nodes[k].accel_bias, gap ? longest_s : 0.0);
  }
}

void InertialChain::dropFront(int count) { segments_.erase(segments_.begin(), segments_.begin() + count); }

void InertialChain::accumulate(const WindowState& state, int first, int last, ChainSystem* system) const {
  for (int i = first; i <= last && i + 1 < static_cast<int>(state.nodes.size()); ++i) {
    const ImuFactor factor(segment(i), noise_);
    const auto k = static_cast<std::size_t>(i);
    const ImuResidual f = factor.evaluate(state.nodes[k], state.nodes[k + 1], state.gravity);
    system->diagonal(i).noalias() += f.J_i.transpose() * f.J_i;
    system->diagonal(i + 1).noalias() += f.J_j.transpose() * f.J_j;
    system->offDiagonal(i, i + 1).noalias() += f.J_i.transpose() * f.J_j;
    system->gradient(i).noalias() += f.J_i.transpose() * f.r;
    system->gradient(i + 1).noalias() += f.J_j.transpose() * f.r;
    system->coupling(i).col(GlobalLayout::kGravity) += f.J_i.transpose() * f.J_gravity;
    system->coupling(i + 1).col(GlobalLayout::kGravity) += f.J_j.transpose() * f.J_gravity;
    system->H_global(GlobalLayout::kGravity, GlobalLayout::kGravity) += f.J_gravity.squaredNorm();
    system->b_global[GlobalLayout::kGravity] += f.J_gravity.dot(f.r);
    system->cost += 0.5 * f.r.squaredNorm();
  }
}

int nodeAt(const std::vector<NavState>& nodes, TimeNs stamp) {
  const auto after = std::upper_bound(nodes.begin(), nodes.end(), stamp,
                                      [](TimeNs t, const NavState& node) { return t < node.stamp; });
  return static_cast<int>(std::max<std::ptrdiff_t>(0, after - nodes.begin() - 1));
}

}  // namespace cocalib
