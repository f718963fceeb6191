#include "cocalib/estimation/lever_excitation.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace cocalib {
namespace {

// Orientations jitter by some tenths of a milliradian where the rig does not turn. 2 mrad for 5 s count as turning:
// then the jitter adds less than a tenth to what shows.
constexpr double kJitter_rad = 3e-4;
constexpr double kEnoughTurning = 2e-3 * 2e-3 * 5.0;  // [rad^2 s]
// Positions, from the accelerometer alone over 2 s, less the parabola that a tilt would make: 3 mm for 5 s.
constexpr double kPiece_s = 2.0;
constexpr double kJitter_m = 1e-3;  // what tenths of a milliradian of tilt that comes and goes leave
constexpr double kWhite = 4.1e-4;   // of the cube of the time: what white noise leaves of its double integral, an axis
constexpr double kEnoughShifting = 0.003 * 0.003 * 5.0;  // [m^2 s]

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

/// Mean square distance of a path from the parabola that fits it best: what neither a velocity, a tilt nor a bias of
/// the accelerometer explains.
double curlOf(const std::vector<double>& times_s, const std::vector<Eigen::Vector3d>& path) {
  const auto n = static_cast<Eigen::Index>(path.size());
  Eigen::MatrixX3d parabola(n, 3), positions(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double t = times_s[static_cast<std::size_t>(i)];
    parabola.row(i) << 1.0, t, t * t;
    positions.row(i) = path[static_cast<std::size_t>(i)];
  }
  const Eigen::Matrix3d fit = (parabola.transpose() * parabola).ldlt().solve(parabola.transpose() * positions);
  return (positions - parabola * fit).squaredNorm() / static_cast<double>(n);
}

/// What the accelerometer says of the IMU's shifting, less its noise, summed over pieces of kPiece_s [m^2 s].
double creditedShift(const std::vector<NavState>& nodes, const InertialChain& chain) {
  const double accel_noise = chain.noise().accel_noise_density;
  const double noise2 = kJitter_m * kJitter_m + 3.0 * kWhite * accel_noise * accel_noise * std::pow(kPiece_s, 3.0);
  double credited = 0.0;
  std::vector<double> times_s;
  std::vector<Eigen::Vector3d> path;
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();
  const auto count = std::min<std::size_t>(nodes.size(), static_cast<std::size_t>(chain.size()));
  for (std::size_t k = 0; k + 1 < count; ++k) {
    const Preintegration& segment = chain.segment(static_cast<int>(k));
    if (segment.end() != nodes[k + 1].stamp) break;
    if (path.empty()) {
      times_s.push_back(0.0);
      path.emplace_back(Eigen::Vector3d::Zero());
      velocity.setZero();
    }
    const ImuIncrement& d = segment.atEnd();
    const Eigen::Vector3d dbg = nodes[k].gyro_bias - segment.gyroBias(),
                          dba = nodes[k].accel_bias - segment.accelBias();
    const Eigen::Matrix3d R = nodes[k].T_W_I.R();
    path.push_back(path.back() + velocity * d.dt_s + R * (d.p + d.J_p_bg * dbg + d.J_p_ba * dba));
    velocity += R * (d.v + d.J_v_bg * dbg + d.J_v_ba * dba);
    times_s.push_back(times_s.back() + d.dt_s);
    if (times_s.back() < kPiece_s) continue;
    credited += times_s.back() * std::max(0.0, curlOf(times_s, path) - noise2);
    path.clear();
    times_s.clear();
  }
  return credited;
}

/// Orthonormal directions along which scatter times duration is too small.
Eigen::Matrix3Xd unturned(const Eigen::Matrix3d& turning) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(turning);
  Eigen::Index count = 0;  // eigenvalues rise
  while (count < 3 && eigen.eigenvalues()[count] < kEnoughTurning) ++count;
  return eigen.eigenvectors().leftCols(count);
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

void LeverExcitation::remember(const std::vector<NavState>& nodes, const InertialChain& chain, int dropped) {
  const double leaving_s = toSeconds(nodes[static_cast<std::size_t>(dropped)].stamp - nodes.front().stamp);
  past_turning_ += leaving_s * creditedScatter(nodes);
  past_shifting_ += leaving_s / durationOf(nodes) * creditedShift(nodes, chain);
}

UnseenLevers LeverExcitation::unseen(const std::vector<NavState>& nodes, const InertialChain& chain) const {
  UnseenLevers result;
  result.directions = unturned(past_turning_ + durationOf(nodes) * creditedScatter(nodes));
  result.scale = past_shifting_ + creditedShift(nodes, chain) < kEnoughShifting;
  return result;
}

Eigen::Matrix3Xd unturnedBy(const std::vector<NavState>& nodes) {
  return unturned(durationOf(nodes) * creditedScatter(nodes));
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
