#include "cocalib/estimation/pose_scatter.h"

namespace cocalib {
namespace {

constexpr int kG = GlobalLayout::kGravity;

/// Adds X at (rows of the calibration and gravity) x (the same) of the dense globals, for a cross term that stands
/// once: X = [calibration; gravity]^T H [calibration; gravity] of two poses, plus its transpose.
void addGlobalPair(const TimedSensorPose& a, const TimedSensorPose& b, int column, const Matrix6d& H,
                   ChainSystem* system) {
  Eigen::Matrix<double, 6, 8> J_a, J_b;
  J_a << a.J_calibration, a.J_gravity;
  J_b << b.J_calibration, b.J_gravity;
  const Eigen::Matrix<double, 8, 8> X = J_a.transpose() * H * J_b;
  const Eigen::Matrix<double, 8, 8> Y = X + X.transpose();
  auto& G = system->H_global;
  G.block<7, 7>(column, column) += Y.topLeftCorner<7, 7>();
  G.block<7, 1>(column, kG) += Y.topRightCorner<7, 1>();
  G.block<1, 7>(kG, column) += Y.bottomLeftCorner<1, 7>();
  G(kG, kG) += Y(7, 7);
}

}  // namespace

void scatterPose(const TimedSensorPose& pose, int node, int column, const Matrix6d& H, const Vector6d& b,
                 ChainSystem* system) {
  const Eigen::Matrix<double, 15, 6> JtH = pose.J_state.transpose() * H;
  system->diagonal(node).noalias() += JtH * pose.J_state;
  system->gradient(node).noalias() += pose.J_state.transpose() * b;
  system->coupling(node).middleCols<7>(column).noalias() += JtH * pose.J_calibration;
  system->coupling(node).col(kG).noalias() += JtH * pose.J_gravity;
  addGlobalPair(pose, pose, column, 0.5 * H, system);
  system->b_global.segment<7>(column).noalias() += pose.J_calibration.transpose() * b;
  system->b_global[kG] += pose.J_gravity.dot(b);
}

void scatterPosePair(const TimedSensorPose& a, int node_a, const TimedSensorPose& b, int node_b, int column,
                     const Matrix6d& H, ChainSystem* system) {
  const Eigen::Matrix<double, 15, 6> JtH_a = a.J_state.transpose() * H;
  const Eigen::Matrix<double, 15, 6> JtH_b = b.J_state.transpose() * H.transpose();
  const Matrix15d block = JtH_a * b.J_state;
  if (node_a == node_b) {
    system->diagonal(node_a) += block + block.transpose();
  } else if (node_a < node_b) {
    system->offDiagonal(node_a, node_b) += block;
  } else {
    system->offDiagonal(node_b, node_a) += block.transpose();
  }
  system->coupling(node_a).middleCols<7>(column).noalias() += JtH_a * b.J_calibration;
  system->coupling(node_a).col(kG).noalias() += JtH_a * b.J_gravity;
  system->coupling(node_b).middleCols<7>(column).noalias() += JtH_b * a.J_calibration;
  system->coupling(node_b).col(kG).noalias() += JtH_b * a.J_gravity;
  addGlobalPair(a, b, column, H, system);
}

}  // namespace cocalib
