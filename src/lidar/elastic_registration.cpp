#include "cocalib/lidar/elastic_registration.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "cocalib/geometry/so3.h"

namespace cocalib {
namespace {

constexpr double kGateFactor = 0.7;        // from one iteration to the next
constexpr double kRotationStep = 1e-5;     // rad; below it the iteration has converged
constexpr double kTranslationStep = 1e-4;  // m

/// Sums of one pass over the points.
struct NormalEquations {
  Matrix18d H = Matrix18d::Zero();
  Vector18d b = Vector18d::Zero();
  Matrix6d rigid = Matrix6d::Zero();  ///< information on one pose of the whole sweep
  double squares = 0.0;               ///< weighted squares of the distances [m^2]
  double weights = 0.0;
  int accepted = 0;
};

/// How much of a change of (begin, end, bow) reaches a point at `fraction`.
Eigen::Vector3d basisAt(double fraction) { return {1.0 - fraction, fraction, 4.0 * fraction * (1.0 - fraction)}; }

/// Coarse voxels while the gate is wide: small ones would hold the neighbouring surface.
int firstLevelFor(double gate_m, double finest_edge_m) {
  if (gate_m > 0.75 * finest_edge_m) return 2;
  return gate_m > 0.4 * finest_edge_m ? 1 : 0;
}

NormalEquations accumulate(const PlanarVoxelMap& map, const std::vector<SweepPoint>& points, const SweepMotion& motion,
                           double gate_m, double sigma_m) {
  NormalEquations sums;
  const SampledMotion path(motion);
  const int first_level = firstLevelFor(gate_m, map.finestEdge());
  for (const SweepPoint& point : points) {
    Eigen::Vector3d arm;
    const Eigen::Vector3d p_M = path.apply(point, &arm);
    const PlanarVoxelMap::LocalPlane* plane = map.nearestPlane(p_M, gate_m, first_level);
    if (plane == nullptr) continue;
    const double r = plane->distance(p_M);
    const double tukey = 1.0 - r * r / (gate_m * gate_m);
    const double weight = tukey * tukey / (sigma_m * sigma_m * (1.0 + plane->leverage(p_M)));
    Vector6d J;
    J << plane->normal, arm.cross(plane->normal);
    const Matrix6d JJ = weight * J * J.transpose();
    const Vector6d Jr = weight * r * J;
    const Eigen::Vector3d basis = basisAt(point.fraction);
    for (int i = 0; i < 3; ++i) {
      for (int j = 0; j <= i; ++j) sums.H.block<6, 6>(6 * i, 6 * j).noalias() += basis[i] * basis[j] * JJ;
      sums.b.segment<6>(6 * i).noalias() -= basis[i] * Jr;
    }
    sums.rigid += JJ;
    sums.squares += tukey * tukey * r * r;
    sums.weights += tukey * tukey;
    ++sums.accepted;
  }
  return sums;
}

/// Adds ||(sum_i c_i x_i + r) / sigma||^2 for 6-vectors x_i = (begin, end, bow).
void addPrior(const Eigen::Vector3d& c, const Vector6d& r, const Vector6d& sigma, NormalEquations* sums) {
  const Vector6d information = sigma.array().square().inverse();
  for (int i = 0; i < 3; ++i) {
    for (int j = 0; j <= i; ++j) {
      sums->H.block<6, 6>(6 * i, 6 * j).diagonal() += c[i] * c[j] * information;
    }
    sums->b.segment<6>(6 * i) -= c[i] * information.cwiseProduct(r);
  }
}

void addPriors(const MotionPrior& prior, const SweepMotion& motion, NormalEquations* sums) {
  addPrior({1.0, 0.0, 0.0}, motion.begin.minus(prior.begin), prior.begin_sigma, sums);
  const Vector6d begin_velocity = motion.end.minus(motion.begin) + 4.0 * motion.bow;
  addPrior({-1.0, 1.0, 4.0}, begin_velocity - prior.begin_velocity, prior.begin_velocity_sigma, sums);
  addPrior({0.0, 0.0, 1.0}, motion.bow, prior.bow_sigma, sums);
}

/// Covariance of one pose of the whole sweep.
Matrix6d covarianceOf(const Matrix6d& information) {
  constexpr double kFloor = 1e-3;  // keeps the inverse finite where nothing at all is seen
  return (information + kFloor * Matrix6d::Identity()).inverse();
}

/// Standard deviation of the worst rotation axis, the translation being free.
double worstRotationSigma(const Matrix6d& covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(covariance.bottomRightCorner<3, 3>(),
                                                              Eigen::EigenvaluesOnly);
  return std::sqrt(std::max(0.0, solver.eigenvalues()[2]));
}

}  // namespace

Pose SweepMotion::at(double fraction) const {
  const Eigen::Vector3d rotation = logSo3(end.q * begin.q.conjugate());
  const Pose straight{expSo3(fraction * rotation) * begin.q, begin.t + fraction * (end.t - begin.t)};
  return straight.plus(4.0 * fraction * (1.0 - fraction) * bow);
}

SampledMotion::SampledMotion(const SweepMotion& motion) {
  for (int i = 0; i <= kIntervals; ++i) {
    const Pose pose = motion.at(static_cast<double>(i) / kIntervals);
    R_[i] = pose.R();
    t_[i] = pose.t;
  }
}

Eigen::Vector3d SampledMotion::apply(const SweepPoint& point, Eigen::Vector3d* rotated) const {
  const double position = std::clamp(point.fraction, 0.0, 1.0) * kIntervals;
  const int i = std::min(static_cast<int>(position), kIntervals - 1);
  const double share = position - i;
  const Eigen::Vector3d arm = (1.0 - share) * (R_[i] * point.p_L) + share * (R_[i + 1] * point.p_L);
  if (rotated != nullptr) *rotated = arm;
  return arm + (1.0 - share) * t_[i] + share * t_[i + 1];
}

ElasticRegistrationResult registerElastic(const PlanarVoxelMap& map, const std::vector<SweepPoint>& points,
                                          const SweepMotion& start, const MotionPrior& prior,
                                          const ElasticRegistrationOptions& options) {
  ElasticRegistrationResult result;
  result.motion = start;
  if (points.empty()) return result;
  double gate_m = options.first_gate_m;
  for (int iteration = 0; iteration < options.max_iterations; ++iteration) {
    NormalEquations sums = accumulate(map, points, result.motion, gate_m, options.point_sigma_m);
    result.overlap = static_cast<double>(sums.accepted) / static_cast<double>(points.size());
    result.rms_m = sums.weights > 0.0 ? std::sqrt(sums.squares / sums.weights) : 0.0;
    const Matrix6d covariance = covarianceOf(sums.rigid);
    result.rotation_sigma = worstRotationSigma(covariance);
    result.translation_covariance = covariance.topLeftCorner<3, 3>();
    addPriors(prior, result.motion, &sums);
    const Vector18d step = sums.H.selfadjointView<Eigen::Lower>().ldlt().solve(sums.b);
    if (!step.allFinite()) return result;
    result.motion.begin = result.motion.begin.plus(step.segment<6>(0));
    result.motion.end = result.motion.end.plus(step.segment<6>(6));
    result.motion.bow += step.segment<6>(12);
    const bool small = step.segment<3>(0).norm() < kTranslationStep && step.segment<3>(6).norm() < kTranslationStep &&
                       step.segment<3>(3).norm() < kRotationStep && step.segment<3>(9).norm() < kRotationStep;
    if (small && gate_m <= options.last_gate_m) break;
    gate_m = std::max(options.last_gate_m, kGateFactor * gate_m);
  }
  return result;
}

}  // namespace cocalib
