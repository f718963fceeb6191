#include "cocalib/estimation/lever_excitation.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

#include "cocalib/inertial/motion_credit.h"

namespace cocalib {
namespace {

constexpr double kEnoughTurning = 2e-3 * 2e-3 * 5.0;  // 2 mrad for 5 s: what jitters adds little [rad^2 s]

MotionCredit creditOf(const std::vector<NavState>& nodes, const InertialChain& chain) {
  MotionCredit credit(chain.noise());
  const auto count = std::min<std::size_t>(nodes.size(), static_cast<std::size_t>(chain.size()));
  for (std::size_t k = 0; k + 1 < count; ++k) {
    const Preintegration& segment = chain.segment(static_cast<int>(k));
    if (segment.end() != nodes[k + 1].stamp) break;  // the newest nodes may not be linked yet
    credit.add(nodes[k], segment);
  }
  return credit;
}

Eigen::Matrix3d meanRotation(const std::vector<NavState>& nodes) {
  Eigen::Matrix3d mean = Eigen::Matrix3d::Zero();
  for (const NavState& node : nodes) mean += node.T_W_I.R() / static_cast<double>(nodes.size());
  return mean;
}

/// Orthonormal directions along which the turning is too small.
Eigen::Matrix3Xd unturned(const Eigen::Matrix3d& turning) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(turning);
  Eigen::Index count = 0;  // eigenvalues rise
  while (count < 3 && eigen.eigenvalues()[count] < kEnoughTurning) ++count;
  return eigen.eigenvectors().leftCols(count);
}

/// Directions that change no measurement, and the coordinates along them: E^T N = 1.
struct NullSpace {
  Eigen::MatrixXd N, E;
};

NullSpace nullSpace(const UnseenLevers& unseen, const LeverLinks& links, const WindowState& state) {
  using Layout = GlobalLayout;
  const Eigen::Matrix3Xd& u = unseen.directions;
  const Eigen::Matrix3Xd moved = (meanRotation(state.nodes) * u).colwise().normalized();
  const bool both = links.camera && links.lidar, together = both && links.lidar_board;
  const Eigen::Index k = u.cols(), lidar = both && !together ? k : 0;  // first column of the lidar's
  // Along the camera's lever arm, as far as it is not there already.
  Eigen::Vector3d along = state.calibration.T_imu_camera.t;
  along -= u * (u.transpose() * along);
  constexpr double kShortest_m = 0.01;
  const bool scale = unseen.scale && links.camera && !links.camera_board && along.norm() > kShortest_m;
  NullSpace space;
  space.N = Eigen::MatrixXd::Zero(Layout::size(static_cast<int>(state.planes.size())), lidar + k + (scale ? 1 : 0));
  space.E = space.N;
  const double share = together ? 0.5 : 1.0;
  if (links.camera) {
    space.N.block(Layout::kCamera, 0, 3, k) = u;
    space.E.block(Layout::kCamera, 0, 3, k) = share * u;
    space.N.block(Layout::kBoard, 0, 3, k) = moved;
  }
  if (links.lidar) {
    space.N.block(Layout::kLidar, lidar, 3, k) = u;
    space.E.block(Layout::kLidar, lidar, 3, k) = share * u;
    for (std::size_t i = 0; i < state.planes.size(); ++i) {
      space.N.block(Layout::plane(static_cast<int>(i)) + 2, lidar, 1, k) = state.planes[i].normal.transpose() * moved;
    }
  }
  if (scale) {
    space.N.rightCols<1>().segment<3>(Layout::kCamera) = along.normalized();
    space.E.rightCols<1>().segment<3>(Layout::kCamera) = along.normalized();
  }
  return space;
}

}  // namespace

void LeverExcitation::remember(const std::vector<NavState>& nodes, const InertialChain& chain, int dropped) {
  const double all_s = toSeconds(nodes.back().stamp - nodes.front().stamp);
  const double leaving_s = toSeconds(nodes[static_cast<std::size_t>(dropped)].stamp - nodes.front().stamp);
  const MotionCredit credit = creditOf(nodes, chain);
  past_turning_ += leaving_s / all_s * credit.turning();
  past_shifting_ += leaving_s / all_s * credit.shifting();
}

UnseenLevers LeverExcitation::unseen(const std::vector<NavState>& nodes, const InertialChain& chain) const {
  const MotionCredit credit = creditOf(nodes, chain);
  return {unturned(past_turning_ + credit.turning()), past_shifting_ + credit.shifting() < kEnoughShifting};
}

void blind(const UnseenLevers& unseen, const LeverLinks& links, const WindowState& state, ChainSystem* system) {
  const auto [N, E] = nullSpace(unseen, links, state);
  if (N.cols() == 0 || !(links.camera || links.lidar)) return;
  // P = 1 - N E^T: the cost of what is left of a step when its part along N is taken out.
  for (int i = 0; i < system->nodes(); ++i) {
    const Eigen::MatrixXd along = system->coupling(i) * N;
    system->coupling(i).noalias() -= along * E.transpose();
  }
  const Eigen::MatrixXd HN = system->H_global * N;
  const Eigen::MatrixXd NHN = N.transpose() * HN;
  system->H_global += E * NHN * E.transpose() - HN * E.transpose() - E * HN.transpose();
  system->b_global -= E * (N.transpose() * system->b_global);
}

}  // namespace cocalib
