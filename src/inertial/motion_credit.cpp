#include "cocalib/inertial/motion_credit.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <utility>

namespace cocalib {
namespace {

constexpr double kPiece_s = 2.0;
constexpr double kJitter_rad = 3e-4;  // what a gyro bias that is off by a milliradian a second leaves
constexpr double kJitter_m = 1e-3;    // what tenths of a milliradian of tilt that comes and goes leave
// Of the time and of its cube, an axis: the variance of white noise's integral about its mean, and of its double
// integral about the best parabola.
constexpr double kWhiteTurn = 1.0 / 6.0, kWhiteShift = 4.1e-4;

}  // namespace

void MotionCredit::Piece::add(const NavState& start, const Preintegration& segment) {
  const ImuIncrement& d = segment.atEnd();
  const Eigen::Vector3d dbg = start.gyro_bias - segment.gyroBias(), dba = start.accel_bias - segment.accelBias();
  // The path needs the same gravity in every segment, and so the state's own tilt.
  const Eigen::Matrix3d R = start.T_W_I.R();
  path.push_back(path.back() + velocity * d.dt_s + R * (d.p + d.J_p_bg * dbg + d.J_p_ba * dba));
  velocity += R * (d.v + d.J_v_bg * dbg + d.J_v_ba * dba);
  turns.push_back(turns.back() * (d.q * expSo3(d.J_q_bg * dbg)).toRotationMatrix());
  times_s.push_back(times_s.back() + d.dt_s);
}

/// u^T S u is the mean square of |R u - mean|, less the noise's.
Eigen::Matrix3d MotionCredit::Piece::turnBeyond(double gyro_noise) const {
  Eigen::Matrix3d mean = Eigen::Matrix3d::Zero();
  for (const Eigen::Matrix3d& R : turns) mean += R / static_cast<double>(turns.size());
  const double noise2 = kJitter_rad * kJitter_rad + 2.0 * kWhiteTurn * gyro_noise * gyro_noise * duration();
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(Eigen::Matrix3d::Identity() - mean.transpose() * mean);
  const Eigen::Vector3d credited = (eigen.eigenvalues().array() - noise2).cwiseMax(0.0);
  return eigen.eigenvectors() * credited.asDiagonal() * eigen.eigenvectors().transpose();
}

/// Mean square distance of the path from the parabola that fits it best, less the noise's: what neither a velocity, a
/// tilt nor a bias of the accelerometer explains.
double MotionCredit::Piece::shiftBeyond(double accel_noise) const {
  const auto n = static_cast<Eigen::Index>(path.size());
  Eigen::MatrixX3d parabola(n, 3), positions(n, 3);
  for (Eigen::Index i = 0; i < n; ++i) {
    const double t = times_s[static_cast<std::size_t>(i)];
    parabola.row(i) << 1.0, t, t * t;
    positions.row(i) = path[static_cast<std::size_t>(i)];
  }
  const Eigen::Matrix3d fit = (parabola.transpose() * parabola).ldlt().solve(parabola.transpose() * positions);
  const double off2 = (positions - parabola * fit).squaredNorm() / static_cast<double>(n);
  const double white2 = 3.0 * kWhiteShift * accel_noise * accel_noise * std::pow(duration(), 3.0);
  return std::max(0.0, off2 - kJitter_m * kJitter_m - white2);
}

void MotionCredit::add(const NavState& start, const Preintegration& segment) {
  piece_.add(start, segment);
  if (piece_.duration() < kPiece_s) return;
  turning_ += piece_.duration() * piece_.turnBeyond(noise_.gyro_noise_density);
  shifting_ += piece_.duration() * piece_.shiftBeyond(noise_.accel_noise_density);
  piece_ = Piece();
}

bool shiftShows(const ImuBuffer& imu, TimeNs from, TimeNs to, const Eigen::Vector3d& gyro_bias) {
  constexpr TimeNs kStep = 200'000'000;
  MotionCredit credit{ImuNoise()};
  NavState state;
  state.stamp = from;
  state.gyro_bias = gyro_bias;
  while (state.stamp + kStep <= to) {
    std::vector<ImuSample> samples = imu.slice(state.stamp, state.stamp + kStep);
    if (samples.size() < 2) break;
    const Preintegration segment(std::move(samples), ImuNoise(), gyro_bias, Eigen::Vector3d::Zero());
    credit.add(state, segment);
    state = propagate(segment, state, 0.0, segment.end());  // gravity's path is a parabola like any other
  }
  return credit.shifting() >= kEnoughShifting;
}

}  // namespace cocalib
