#include "credited_motion.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace cocalib {
namespace {

constexpr double kPiece_s = 2.0;
constexpr double kJitter_rad = 3e-4;  // what a gyro bias that is off by a milliradian a second leaves
constexpr double kJitter_m = 1e-3;    // what tenths of a milliradian of tilt that comes and goes leave
// Of the time and of its cube, an axis: the variance of white noise's integral about its mean, and of its double
// integral about the best parabola.
constexpr double kWhiteTurn = 1.0 / 6.0, kWhiteShift = 4.1e-4;

/// What the IMU alone says of its motion since the piece began; gravity left out.
struct Piece {
  std::vector<double> times_s = {0.0};
  std::vector<Eigen::Matrix3d> turns = {Eigen::Matrix3d::Identity()};
  std::vector<Eigen::Vector3d> path = {Eigen::Vector3d::Zero()};
  Eigen::Vector3d velocity = Eigen::Vector3d::Zero();

  double duration() const { return times_s.back(); }

  void add(const NavState& node, const Preintegration& segment) {
    const ImuIncrement& d = segment.atEnd();
    const Eigen::Vector3d dbg = node.gyro_bias - segment.gyroBias(), dba = node.accel_bias - segment.accelBias();
    // The path needs the same gravity in every segment, and so the node's own tilt.
    const Eigen::Matrix3d R = node.T_W_I.R();
    path.push_back(path.back() + velocity * d.dt_s + R * (d.p + d.J_p_bg * dbg + d.J_p_ba * dba));
    velocity += R * (d.v + d.J_v_bg * dbg + d.J_v_ba * dba);
    turns.push_back(turns.back() * (d.q * expSo3(d.J_q_bg * dbg)).toRotationMatrix());
    times_s.push_back(times_s.back() + d.dt_s);
  }
};

/// u^T S u is the mean square of |R u - mean|, less the noise's.
Eigen::Matrix3d turnOf(const Piece& piece, double gyro_noise) {
  Eigen::Matrix3d mean = Eigen::Matrix3d::Zero();
  for (const Eigen::Matrix3d& R : piece.turns) mean += R / static_cast<double>(piece.turns.size());
  const double noise2 = kJitter_rad * kJitter_rad + 2.0 * kWhiteTurn * gyro_noise * gyro_noise * piece.duration();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(Eigen::Matrix3d::Identity() - mean.transpose() * mean);
  const Eigen::Vector3d credited = (eigen.eigenvalues().array() - noise2).cwiseMax(0.0);
  return eigen.eigenvectors() * credited.asDiagonal() * eigen.eigenvectors().transpose();
}

/// Mean square distance of the path from the parabola that fits it best, less the noise's: what neither a velocity, a
/// tilt nor a bias of the accelerometer explains.
double shiftOf(const Piece& piece, double accel_noise) {
  const auto n = static_cast<Eigen::Index>(piece.path.size());
  Eigen::MatrixX3d parabola(n, 3), positions(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double t = piece.times_s[static_cast<std::size_t>(i)];
    parabola.row(i) << 1.0, t, t * t;
    positions.row(i) = piece.path[static_cast<std::size_t>(i)];
  }
  const Eigen::Matrix3d fit = (parabola.transpose() * parabola).ldlt().solve(parabola.transpose() * positions);
  const double off2 = (positions - parabola * fit).squaredNorm() / static_cast<double>(n);
  const double white2 = 3.0 * kWhiteShift * accel_noise * accel_noise * std::pow(piece.duration(), 3.0);
  return std::max(0.0, off2 - kJitter_m * kJitter_m - white2);
}

}  // namespace

CreditedMotion creditedMotion(const std::vector<NavState>& nodes, const InertialChain& chain) {
  CreditedMotion credited;
  const ImuNoise& noise = chain.noise();
  const auto count = std::min<std::size_t>(nodes.size(), static_cast<std::size_t>(chain.size()));
  Piece piece;
  for (std::size_t k = 0; k + 1 < count; ++k) {
    const Preintegration& segment = chain.segment(static_cast<int>(k));
    if (segment.end() != nodes[k + 1].stamp) break;  // the newest nodes may not be linked yet
    piece.add(nodes[k], segment);
    if (piece.duration() < kPiece_s) continue;
    credited.turning += piece.duration() * turnOf(piece, noise.gyro_noise_density);
    credited.shifting += piece.duration() * shiftOf(piece, noise.accel_noise_density);
    piece = Piece();
  }
  return credited;
}

}  // namespace cocalib
