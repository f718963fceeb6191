#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

#include "cocalib/geometry/so3.h"
#include "cocalib/initialization/robust.h"
#include "cocalib/initialization/rotation_search.h"

namespace cocalib {
namespace {

constexpr int kMaxIterations = 30;
constexpr double kCauchySigmas = 1.5;  // pairs differ in quality by a factor of 20; the best should count most
constexpr double kSmallestScale_rad = 1e-6;
constexpr double kConverged = 1e-8;  // [rad], [rad/s], [s]: far below any noise

using Vector7d = Eigen::Matrix<double, 7, 1>;
using Matrix7d = Eigen::Matrix<double, 7, 7>;
using Matrix37d = Eigen::Matrix<double, 3, 7>;

/// Residual of one pair, r = Log(R_gyro^T  X R_sensor X^T) with X = R_imu_sensor, and its Jacobian over
/// (rotation of X from the left, gyro bias, offset).
struct PairResidual {
  Eigen::Vector3d r;
  Matrix37d J;
};

PairResidual evaluatePair(const InertialPath& gyro, const RelativeSensorRotation& pair, const Eigen::Quaterniond& X,
                          double offset_s) {
  const InertialIncrement a = gyro.at(pair.stamp_a + toNs(offset_s));
  const InertialIncrement b = gyro.at(pair.stamp_b + toNs(offset_s));
  const Eigen::Quaterniond gyro_a_b = a.R_0_t.conjugate() * b.R_0_t;
  const Eigen::Quaterniond sensor_a_b = X * pair.R_a_b.normalized() * X.conjugate();
  const Eigen::Matrix3d G_t = gyro_a_b.conjugate().toRotationMatrix();

  PairResidual result;
  result.r = logSo3(gyro_a_b.conjugate() * sensor_a_b);
  // X -> Exp(d) X: sensor_a_b -> sensor_a_b Exp((sensor_a_b^T - I) d).
  const Eigen::Matrix3d right = inverseLeftJacobianSo3(-result.r);
  result.J.leftCols<3>() = right * (sensor_a_b.conjugate().toRotationMatrix() - Eigen::Matrix3d::Identity());
  // gyro_a_b -> gyro_a_b Exp(phi) with phi from bias and offset at both ends.
  const Eigen::Matrix3d left = inverseLeftJacobianSo3(result.r);
  result.J.middleCols<3>(3) = -left * (b.R_bg - G_t * a.R_bg);
  result.J.col(6) = -left * (b.rate - G_t * a.rate);
  return result;
}

/// Normal equations at one linearisation point.
struct NormalEquations {
  Matrix7d H = Matrix7d::Zero();
  Vector7d g = Vector7d::Zero();
  Matrix7d curvature = Matrix7d::Zero();  ///< of the robust loss, and
  Matrix7d scatter = Matrix7d::Zero();    ///< covariance of the gradient: together the sandwich covariance (Huber)
  double median_length = 0.0;             ///< of the residuals [rad]

  Matrix7d covariance() const {
    const Matrix7d inverse = curvature.inverse();
    return inverse * scatter * inverse.transpose();
  }
};

NormalEquations normalEquations(const InertialPath& gyro, const std::vector<RelativeSensorRotation>& rotations,
                                const Eigen::Quaterniond& X, double offset_s) {
  std::vector<PairResidual> residuals;
  std::vector<double> lengths;
  for (const RelativeSensorRotation& pair : rotations) {
    residuals.push_back(evaluatePair(gyro, pair, X, offset_s));
    lengths.push_back(residuals.back().r.norm());
  }
  NormalEquations result;
  result.median_length = medianOf(lengths);
  const double scale = kCauchySigmas * std::max(result.median_length / kMedianLength3, kSmallestScale_rad);
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    const double weight = cauchyWeight(lengths[i], scale);
    // Mean over directions of the derivative of weight * r.
    const double slope = weight - 2.0 / 3.0 * weight * weight * lengths[i] * lengths[i] / (scale * scale);
    const Matrix7d JtJ = residuals[i].J.transpose() * residuals[i].J;
    const Vector7d gradient = weight * residuals[i].J.transpose() * residuals[i].r;
    result.H += weight * JtJ;
    result.g += gradient;
    result.curvature += slope * JtJ;
    result.scatter += gradient * gradient.transpose();
  }
  // A hair of damping keeps the step finite along what the motion does not show; the sigmas then tell.
  result.H.diagonal().array() += 1e-12 * result.H.trace();
  result.curvature.diagonal().array() += 1e-12 * result.H.trace();
  return result;
}

/// Span of the IMU's clock that the pairs need at an offset.
std::optional<InertialPath> pathOver(const ImuBuffer& imu, const std::vector<RelativeSensorRotation>& rotations,
                                     double offset_s, const Eigen::Vector3d& bias) {
  TimeNs first = rotations.front().stamp_a, last = rotations.front().stamp_b;
  for (const RelativeSensorRotation& pair : rotations) {
    first = std::min(first, pair.stamp_a);
    last = std::max(last, pair.stamp_b);
  }
  if (imu.empty()) return std::nullopt;
  first = std::max(first + toNs(offset_s), imu.firstStamp());
  last = std::min(last + toNs(offset_s), imu.lastStamp());
  return InertialPath::integrate(imu, first, last, bias, Eigen::Vector3d::Zero());
}

/// Gauss-Newton from a start to convergence.
std::optional<RotationInitialization> minimize(const ImuBuffer& imu,
                                               const std::vector<RelativeSensorRotation>& rotations,
                                               RotationInitialization result) {
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const auto gyro = pathOver(imu, rotations, result.time_offset_s, result.gyro_bias);
    if (!gyro) return std::nullopt;
    const NormalEquations normal = normalEquations(*gyro, rotations, result.R_imu_sensor, result.time_offset_s);
    result.median_residual_rad = normal.median_length;
    const Matrix7d covariance = normal.covariance();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> rotation(covariance.topLeftCorner<3, 3>());
    result.rotation_sigma_rad = std::sqrt(std::max(0.0, rotation.eigenvalues()[2]));
    result.time_offset_sigma_s = std::sqrt(std::max(0.0, covariance(6, 6)));

    Vector7d step = -normal.H.ldlt().solve(normal.g);
    constexpr double kMaxOffsetStep_s = 0.05;  // the rates are not linear in time over more
    if (std::abs(step[6]) > kMaxOffsetStep_s) step *= kMaxOffsetStep_s / std::abs(step[6]);
    result.R_imu_sensor = (expSo3(step.head<3>()) * result.R_imu_sensor).normalized();
    result.gyro_bias += step.segment<3>(3);
    result.time_offset_s += step[6];
    if (step.norm() < kConverged) break;
  }
  return result;
}

/// Rotations over up to kBaseline_s, one from every pair on, chained from neighbouring pairs that fit. Where each pair
/// comes from two poses of a map, the errors in between cancel and the long rotation is as good as the short one.
std::vector<RelativeSensorRotation> chainPairs(const ImuBuffer& imu,
                                               const std::vector<RelativeSensorRotation>& rotations,
                                               const RotationInitialization& fit) {
  constexpr double kBaseline_s = 0.6;
  constexpr double kGrossMedians = 3.0;  // 4.6 sigma
  std::vector<RelativeSensorRotation> chained;
  const auto gyro = pathOver(imu, rotations, fit.time_offset_s, fit.gyro_bias);
  if (!gyro) return chained;
  std::vector<bool> fits;
  for (const RelativeSensorRotation& pair : rotations) {
    const double length = evaluatePair(*gyro, pair, fit.R_imu_sensor, fit.time_offset_s).r.norm();
    fits.push_back(length < kGrossMedians * std::max(fit.median_residual_rad, kSmallestScale_rad));
  }
  for (std::size_t first = 0; first < rotations.size(); ++first) {
    if (!fits[first]) continue;
    RelativeSensorRotation chain = rotations[first];
    for (std::size_t i = first + 1; i < rotations.size() && fits[i]; ++i) {
      if (rotations[i].stamp_a != chain.stamp_b || rotations[i].stamp_b - chain.stamp_a > toNs(kBaseline_s)) break;
      chain = {chain.stamp_a, rotations[i].stamp_b, chain.R_a_b * rotations[i].R_a_b};
    }
    if (chain.stamp_b != rotations[first].stamp_b) chained.push_back(chain);
  }
  return chained;
}

double meanDuration(const std::vector<RelativeSensorRotation>& rotations) {
  double sum = 0.0;
  for (const RelativeSensorRotation& pair : rotations) sum += toSeconds(pair.stamp_b - pair.stamp_a);
  return sum / static_cast<double>(rotations.size());
}

}  // namespace

std::optional<RotationInitialization> refineRotation(const ImuBuffer& imu,
                                                     const std::vector<RelativeSensorRotation>& rotations,
                                                     const RotationCandidate& start) {
  RotationInitialization initial;
  initial.R_imu_sensor = start.R_imu_sensor;
  initial.gyro_bias = start.gyro_bias;
  initial.time_offset_s = start.time_offset_s;
  const auto from_pairs = minimize(imu, rotations, initial);
  if (!from_pairs) return std::nullopt;

  const std::vector<RelativeSensorRotation> chains = chainPairs(imu, rotations, *from_pairs);
  if (chains.size() < rotations.size() / 3) return from_pairs;
  auto from_chains = minimize(imu, chains, *from_pairs);
  if (!from_chains) return from_pairs;
  // Chains overlap. If their residuals grow like those of a random walk, as many of them as one chain is long say the
  // same thing; if they do not grow, each says something new.
  const double growth = from_chains->median_residual_rad / std::max(from_pairs->median_residual_rad, 1e-9);
  const double repeats =
      std::clamp(growth * growth, 1.0, std::max(1.0, meanDuration(chains) / meanDuration(rotations)));
  from_chains->rotation_sigma_rad *= std::sqrt(repeats);
  from_chains->time_offset_sigma_s *= std::sqrt(repeats);
  from_chains->median_residual_rad = from_pairs->median_residual_rad;
  return from_chains->rotation_sigma_rad < from_pairs->rotation_sigma_rad ? from_chains : from_pairs;
}

}  // namespace cocalib
