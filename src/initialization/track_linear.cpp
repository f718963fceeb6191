#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "cocalib/initialization/robust.h"
#include "cocalib/initialization/track_alignment.h"

namespace cocalib {
namespace {

constexpr int kReweightings = 8;
constexpr double kCauchySigmas = 2.0;
constexpr double kNearest_m = 0.2;  // depth below which a landmark is not believed
constexpr double kSmallestSigma_rad = 2e-4;
constexpr double kVelocityPrior = 10.0;  // [m/s]
constexpr double kBehindWeight = 1e-2;   // of a sight whose landmark came out behind the camera

using Matrix3x12 = Eigen::Matrix<double, 3, 12>;
using Vector12 = Eigen::Matrix<double, 12, 1>;
using Matrix12 = Eigen::Matrix<double, 12, 12>;

/// Camera position in its chunk: known + J z with z = (velocity, gravity, accelerometer bias, lever arm).
struct CameraPosition {
  Eigen::Vector3d known;
  Matrix3x12 J;
};

class LinearTracks {
 public:
  LinearTracks(TrackProblem& problem, const AlignmentParams& params)
      : problem_(problem),
        prior_(priorInformation(params)),
        depths_(problem.tracks.size()),
        weights_(problem.tracks.size()) {
    for (std::size_t f = 0; f < problem.increments.size(); ++f) positions_.push_back(positionOf(f));
    for (std::size_t k = 0; k < problem.tracks.size(); ++k) {
      depths_[k].assign(problem.tracks[k].sights.size(), 1.0);
      weights_[k].assign(problem.tracks[k].sights.size(), 1.0);
    }
  }

  TrackSolution solve() {
    for (int iteration = 0; iteration < kReweightings; ++iteration) {
      accumulate();
      SharedInformation all = prior_;
      for (std::size_t c = 0; c < chunks_.size(); ++c) all += reduced(chunks_[c]);
      const SharedSolution free = solveFree(all);
      solution_.free_gravity = free.gravity();
      solution_.free_gravity_sigma = free.gravitySigma();
      solution_.shared = solveWithGravity(all, kStandardGravity);
      backSubstitute();
      reweight();
    }
    return solution_;
  }

 private:
  struct ChunkEquations {
    Matrix12 H = Matrix12::Zero();
    Vector12 b = Vector12::Zero();
  };

  CameraPosition positionOf(std::size_t frame) const {
    const InertialIncrement& increment = problem_.increments[frame];
    const Eigen::Matrix3d R_G_chunk = problem_.R_G_chunk[problem_.chunk_of_frame[frame]].toRotationMatrix();
    CameraPosition position{R_G_chunk * increment.p, {}};
    position.J << increment.time_s * Eigen::Matrix3d::Identity(),
        0.5 * increment.time_s * increment.time_s * Eigen::Matrix3d::Identity(), R_G_chunk * increment.p_ba,
        problem_.R_G_I(frame).toRotationMatrix();
    return position;
  }

  /// Weighted projection that a sight puts on (landmark - camera).
  Eigen::Matrix3d projection(std::size_t k, std::size_t s) const {
    const TrackSight& sight = problem_.tracks[k].sights[s];
    const Eigen::Vector3d d = problem_.R_G_C(sight.frame) * sight.bearing_C;
    const double scale = 1.0 / (sigma_ * depths_[k][s]);
    return weights_[k][s] * scale * scale * (Eigen::Matrix3d::Identity() - d * d.transpose());
  }

  /// X = offset + slope z minimises a track's cost.
  void landmark(std::size_t k, Eigen::Vector3d& offset, Matrix3x12& slope, Eigen::LDLT<Eigen::Matrix3d>& ldlt) const {
    Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
    offset.setZero();
    slope.setZero();
    const auto& sights = problem_.tracks[k].sights;
    for (std::size_t s = 0; s < sights.size(); ++s) {
      const Eigen::Matrix3d P = projection(k, s);
      H += P;
      offset += P * positions_[sights[s].frame].known;
      slope += P * positions_[sights[s].frame].J;
    }
    H.diagonal().array() += 1e-9 * H.trace();
    ldlt.compute(H);
    offset = ldlt.solve(offset).eval();
    slope = ldlt.solve(slope).eval();
  }

  void accumulate() {
    chunks_.assign(problem_.chunks.size(), {});
    for (ChunkEquations& chunk : chunks_) {
      chunk.H.diagonal().head<3>().setConstant(1.0 / (kVelocityPrior * kVelocityPrior));
    }
    Eigen::LDLT<Eigen::Matrix3d> ldlt;
    for (std::size_t k = 0; k < problem_.tracks.size(); ++k) {
      Eigen::Vector3d offset;
      Matrix3x12 slope;
      landmark(k, offset, slope, ldlt);
      ChunkEquations& chunk = chunks_[problem_.tracks[k].chunk];
      const auto& sights = problem_.tracks[k].sights;
      for (std::size_t s = 0; s < sights.size(); ++s) {
        const CameraPosition& camera = positions_[sights[s].frame];
        const Eigen::Matrix3d P = projection(k, s);
        const Matrix3x12 J = slope - camera.J;
        chunk.H += J.transpose() * P * J;
        chunk.b -= J.transpose() * (P * (offset - camera.known));
      }
    }
  }

  static SharedInformation reduced(const ChunkEquations& chunk) {
    const Eigen::LDLT<Eigen::Matrix3d> ldlt(chunk.H.topLeftCorner<3, 3>());
    const Eigen::Matrix<double, 3, 9> cross = chunk.H.topRightCorner<3, 9>();
    SharedInformation result;
    result.H = chunk.H.bottomRightCorner<9, 9>() - cross.transpose() * ldlt.solve(cross);
    result.b = chunk.b.tail<9>() - cross.transpose() * ldlt.solve(chunk.b.head<3>());
    return result;
  }

  void backSubstitute() {
    solution_.velocities.clear();
    solution_.worst_velocity_sigma = 0.0;
    for (const ChunkEquations& chunk : chunks_) {
      const Eigen::LDLT<Eigen::Matrix3d> ldlt(chunk.H.topLeftCorner<3, 3>());
      const Eigen::Matrix<double, 3, 9> slope = -ldlt.solve(chunk.H.topRightCorner<3, 9>());
      solution_.velocities.push_back(ldlt.solve(chunk.b.head<3>()) + slope * solution_.shared.x);
      const Eigen::Matrix3d covariance =
          ldlt.solve(Eigen::Matrix3d::Identity()).eval() + slope * solution_.shared.covariance * slope.transpose();
      const double sigma = std::sqrt(std::max(0.0, covariance.diagonal().maxCoeff()));
      solution_.worst_velocity_sigma = std::max(solution_.worst_velocity_sigma, sigma);
    }
    Eigen::LDLT<Eigen::Matrix3d> ldlt;
    for (std::size_t k = 0; k < problem_.tracks.size(); ++k) {
      Eigen::Vector3d offset;
      Matrix3x12 slope;
      landmark(k, offset, slope, ldlt);
      problem_.tracks[k].X_G = offset + slope * unknowns(problem_.tracks[k].chunk);
    }
  }

  Vector12 unknowns(std::size_t chunk) const {
    Vector12 z;
    z << solution_.velocities[chunk], solution_.shared.x;
    return z;
  }

  void reweight() {
    std::vector<double> angles;
    for (std::size_t k = 0; k < problem_.tracks.size(); ++k) {
      const ChunkTrack& track = problem_.tracks[k];
      for (std::size_t s = 0; s < track.sights.size(); ++s) {
        const TrackSight& sight = track.sights[s];
        const CameraPosition& camera = positions_[sight.frame];
        const Eigen::Vector3d ray = track.X_G - camera.known - camera.J * unknowns(track.chunk);
        const Eigen::Vector3d d = problem_.R_G_C(sight.frame) * sight.bearing_C;
        depths_[k][s] = std::max(d.dot(ray), kNearest_m);
        angles.push_back((ray - d * d.dot(ray)).norm() / depths_[k][s]);
        weights_[k][s] = d.dot(ray) > kNearest_m ? 1.0 : kBehindWeight;
      }
    }
    sigma_ = std::max(medianOf(angles) / kMedianLength2, kSmallestSigma_rad);
    solution_.bearing_sigma_rad = sigma_;
    std::size_t next = 0;
    for (std::vector<double>& of_track : weights_) {
      for (double& weight : of_track) weight *= cauchyWeight(angles[next++], kCauchySigmas * sigma_);
    }
  }

  TrackProblem& problem_;
  SharedInformation prior_;
  std::vector<CameraPosition> positions_;     ///< of each frame
  std::vector<std::vector<double>> depths_;   ///< of each sight of each track [m]
  std::vector<std::vector<double>> weights_;  ///< robust
  double sigma_ = 2e-3;                       ///< of a bearing [rad]
  std::vector<ChunkEquations> chunks_;
  TrackSolution solution_;
};

}  // namespace

TrackSolution solveTracksLinearly(TrackProblem& problem, const AlignmentParams& params) {
  return LinearTracks(problem, params).solve();
}

}  // namespace cocalib
