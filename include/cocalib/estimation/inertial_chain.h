#pragma once

#include <memory>
#include <vector>

#include "cocalib/estimation/window_state.h"
#include "cocalib/inertial/imu_buffer.h"
#include "cocalib/inertial/preintegration.h"

namespace cocalib {

/// The inertial segments between the nodes of a window. Segment k starts at node k; the last node has one too, which
/// reaches a little beyond it, so that every node can be propagated from.
class InertialChain {
 public:
  explicit InertialChain(const ImuNoise& noise) : noise_(noise) {}

  const ImuNoise& noise() const { return noise_; }
  /// Replaces the noise; the next update() makes all segments anew.
  void setNoise(const ImuNoise& noise) {
    noise_ = noise;
    for (auto& segment : segments_) segment.reset();
  }

  /// Makes (or makes anew where the biases have moved far from the linearisation) the segments of `nodes`.
  void update(const std::vector<NavState>& nodes, const ImuBuffer& imu);
  /// Forgets the segments of the first `count` nodes.
  void dropFront(int count);

  const Preintegration& segment(int node) const { return *segments_[static_cast<std::size_t>(node)]; }
  int size() const { return static_cast<int>(segments_.size()); }

  /// Adds the inertial factors of nodes [first, last] (between each and the next) to the system.
  void accumulate(const WindowState& state, int first, int last, ChainSystem* system) const;

 private:
  ImuNoise noise_;
  std::vector<std::shared_ptr<const Preintegration>> segments_;
};

/// Node whose segment covers `stamp` (the last one at or before it; the first for earlier times).
int nodeAt(const std::vector<NavState>& nodes, TimeNs stamp);

}  // namespace cocalib
