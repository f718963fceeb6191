#include "cocalib/estimation/lever_excitation.h"

#include <Eigen/Eigenvalues>
#include <algorithm>

namespace cocalib {
namespace {

// Orientations jitter by some tenths of a milliradian where the rig does not turn. 2 mrad for 5 s count as turning:
// then the jitter adds less than a tenth to what shows.
constexpr double kJitter_rad = 3e-4;
constexpr double kEnoughTurning = 2e-3 * 2e-3 * 5.0;  // [rad^2 s]
// The same for positions: a centimetre for 5 s.
constexpr double kJitter_m = 3e-3;
constexpr double kEnoughShifting = 0.01 * 0.01 * 5.0;  // [m^2 s]

Eigen::Matrix3d meanRotation(const std::vector<NavState>& nodes) {
  Eigen::Matrix3d mean = Eigen::Matrix3d::Zero();
  for (const NavState& node : nodes) mean += node.T_W_I.R() / static_cast<double>(nodes.size());
  return mean;
}

/// u^T S u is the mean square of |R u - mean|, less the jitter's.
Eigen::Matrix3d creditedScatter(const std::vector<NavState>& nodes) {
  const Eigen::Matrix3d mean = meanRotation(nodes);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(Eigen::Matrix3d::Identity() - mean.transpose() * mean);
  const Eigen::Vector3d credited = (eigen.eigenvalues().array() - kJitter_rad * kJitter_rad).cwiseMax(0.0);
  return eigen.eigenvectors() * credited.asDiagonal() * eigen.eigenvectors().transpose();
}

/// Mean square distance of the positions from their mean, less the jitter's.
double creditedShift(const std::vector<NavState>& nodes) {
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  double square = 0.0;
  for (const NavState& node : nodes) mean += node.T_W_I.t / static_cast<double>(nodes.size());
  for (const NavState& node : nodes) {
    square += (node.T_W_I.t - mean).squaredNorm() / static_cast<double>(nodes.size());
  }
  return std::max(0.0, square - kJitter_m * kJitter_m);
}

double durationOf(const std::vector<NavState>& nodes) { return toSeconds(nodes.back().stamp - nodes.front().stamp); }

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

void LeverExcitation::remember(const std::vector<NavState>& nodes, int dropped) {
  const double leaving_s = toSeconds(nodes[static_cast<std::size_t>(dropped)].stamp - nodes.front().stamp);
  past_turning_ += leaving_s * creditedScatter(nodes);
  past_shifting_ += leaving_s * creditedShift(nodes);
}

UnseenLevers LeverExcitation::unseen(const std::vector<NavState>& nodes) const {
  const double duration_s = durationOf(nodes);
  const Eigen::Matrix3d turning = past_turning_ + duration_s * creditedScatter(nodes);
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(turning);
  Eigen::Index count = 0;  // eigenvalues rise
  while (count < 3 && eigen.eigenvalues()[count] < kEnoughTurning) ++count;
  UnseenLevers result;
  result.directions = eigen.eigenvectors().leftCols(count);
  result.scale = past_shifting_ + duration_s * creditedShift(nodes) < kEnoughShifting;
  return result;
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
