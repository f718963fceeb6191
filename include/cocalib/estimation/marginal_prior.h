#pragma once

#include <Eigen/Core>
#include <vector>

#include "cocalib/estimation/window_state.h"

namespace cocalib {

/// What eliminated states said about those that stay: 1/2 d^T H d + b^T d, with d = state minus base, over some nodes
/// and the globals, planes included.
class MarginalPrior {
 public:
  /// @param marginal  of ChainSystem::marginalizeFront(dropped)
  /// @param state     after the first `dropped` nodes have gone; where the marginal was linearised
  MarginalPrior(ChainSystem::Marginal marginal, int dropped, const WindowState& state);

  /// @pre every plane that the prior knows is still in `state`
  void accumulate(const WindowState& state, ChainSystem* system) const;

  /// Eliminates a plane: what it said about everything else stays, its number is free. Planes that the prior does not
  /// know are none of its business.
  void forgetPlane(int index);
  /// Centres a number that was free on its new plane, of which nothing is known.
  void startPlane(int index, const Plane& plane);

 private:
  std::vector<int> nodes_;
  WindowState base_;
  Eigen::MatrixXd H_;  ///< nodes first, then the globals
  Eigen::VectorXd b_;
};

}  // namespace cocalib
