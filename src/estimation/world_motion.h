#pragma once

#include <Eigen/Core>
#include <utility>
#include <vector>

#include "cocalib/estimation/window_state.h"

namespace cocalib {

/// Tangent that leads from `base` to a state and its derivative over the state, taken so that it stays true when
/// everything in the world moves together.
///
/// Nothing that a window measures changes when nodes, board and planes are all moved by one rigid motion A; only
/// gravity sees its tilt. A difference number by number is linear in small changes alone: after a common turn by 20
/// mrad its second order, times meters, is a millimetre, and a prior that knows distances to a tenth of one takes it
/// for a contradiction. So A, the motion of the first node, is taken out: d = N xi + (A^-1 state - base), N the change
/// of the base under the small motion xi = log A. What a prior does not know at its base (position, heading) it then
/// does not know anywhere: the same end as first-estimate Jacobians (Huang, Mourikis, Roumeliotis 2010).
///
/// Nodes come first (15 numbers each; at least one), then the globals as far as `base` has planes.
class WorldMotion {
 public:
  /// @param nodes  of the state, one for each of base's
  WorldMotion(const std::vector<NavState>& nodes, const WindowState& state, const WindowState& base);

  const Eigen::VectorXd& difference() const { return d_; }
  /// M^T H M and M^T g, with M the derivative of difference() over the state's own tangent.
  Eigen::MatrixXd pullBack(const Eigen::MatrixXd& H) const;
  Eigen::VectorXd pullBack(const Eigen::VectorXd& g) const;

 private:
  using Rows36 = Eigen::Matrix<double, 3, 6>;

  void addPose(Eigen::Index at, const Pose& now, const Pose& base);
  void addNode(Eigen::Index at, const NavState& now, const NavState& base);
  void addPlane(Eigen::Index at, const Plane& now, const Plane& base);

  Pose A_inverse_;
  Eigen::Matrix3d Q_t_;                     // rotation of A^-1
  Eigen::Vector3d theta_, shift_;           // xi: the base turns by theta about the origin and shifts
  Eigen::Matrix3d J_theta_;                 // derivative of theta over the first node's turn
  Eigen::Vector3d first_now_, first_base_;  // positions of the first node
  Eigen::VectorXd d_;
  // M = D + U E: D has 3x3 blocks on its diagonal (identity where none is listed), E picks the first node's pose.
  std::vector<std::pair<Eigen::Index, Eigen::Matrix3d>> blocks_;
  Eigen::Matrix<double, Eigen::Dynamic, 6> U_;
};

}  // namespace cocalib
