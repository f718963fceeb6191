#include "cocalib/visual/two_view.h"

#include <Eigen/Cholesky>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>
#include <random>

#include "cocalib/geometry/so3.h"

namespace cocalib {
namespace {

constexpr std::uint32_t kSeed = 20240501;
constexpr int kRotationTrials = 60, kTranslationTrials = 80;  // 2-point models: > 0.9999 at half outliers
constexpr double kMinNormalizer = 1e-6;                       // of epipolarError() squared: a point at the epipole
constexpr double kMinBearingZ = 0.1;                          // for the five-point method, which works on z = 1

/// Two different indices below n, without the platform-dependent std::uniform_int_distribution.
std::pair<std::size_t, std::size_t> drawPair(std::mt19937* random, std::size_t n) {
  const std::size_t first = (*random)() % n;
  const std::size_t second = (first + 1 + (*random)() % (n - 1)) % n;
  return {first, second};
}

/// Rotation that takes a0 to b0 exactly and a1 as near to b1 as it can.
Eigen::Quaterniond rotationFromPairs(const Eigen::Vector3d& a0, const Eigen::Vector3d& a1, const Eigen::Vector3d& b0,
                                     const Eigen::Vector3d& b1) {
  const auto frame = [](const Eigen::Vector3d& x, const Eigen::Vector3d& other) {
    Eigen::Matrix3d R;
    const Eigen::Vector3d z = x.cross(other).normalized();
    R << x, z.cross(x), z;
    return R;
  };
  return Eigen::Quaterniond(frame(b0, b1) * frame(a0, a1).transpose()).normalized();
}

Eigen::Quaterniond refineRotation(const BearingPairs& pairs, Eigen::Quaterniond R, double scale_rad) {
  for (int iteration = 0; iteration < 10; ++iteration) {
    Eigen::Matrix3d H = Eigen::Matrix3d::Identity() * 1e-9;
    Eigen::Vector3d g = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      const Eigen::Vector3d q = R * pairs.a[i];
      const Eigen::Vector3d r = pairs.b[i] - q;  // d(Exp(d) q)/dd = -hat(q)
      const double weight = 1.0 / (1.0 + r.squaredNorm() / (scale_rad * scale_rad));
      H += weight * (Eigen::Matrix3d::Identity() - q * q.transpose());
      g += weight * q.cross(r);
    }
    const Eigen::Vector3d step = H.ldlt().solve(g);
    R = (expSo3(step) * R).normalized();
    if (step.norm() < 1e-7) break;
  }
  return R;
}

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;
using TangentBasis = Eigen::Matrix<double, 3, 2>;

TangentBasis tangentBasis(const Eigen::Vector3d& t) {
  const Eigen::Vector3d axis = std::abs(t.x()) < 0.6 ? Eigen::Vector3d::UnitX() : Eigen::Vector3d::UnitY();
  TangentBasis basis;
  basis.col(0) = t.cross(axis).normalized();
  basis.col(1) = t.cross(basis.col(0));
  return basis;
}

/// epipolarError() with its derivative over (rotation, two tangent directions of t).
double epipolarError(const TwoViewMotion& motion, const Eigen::Vector3d& a, const Eigen::Vector3d& b,
                     const TangentBasis& basis, Vector5d* J) {
  const Eigen::Vector3d &t = motion.t_b_a, q = motion.R_b_a * a;
  const double e = b.dot(t.cross(q)), t_q = t.dot(q), t_b = t.dot(b);
  const double n2 = std::max(kMinNormalizer, 2.0 - t_q * t_q - t_b * t_b - 2.0 * e * e);
  const double inv_n = 1.0 / std::sqrt(n2);
  const Eigen::Vector3d e_theta = q.cross(b.cross(t)), e_t = q.cross(b);
  const Eigen::Vector3d n2_theta = -2.0 * t_q * q.cross(t) - 4.0 * e * e_theta;
  const Eigen::Vector3d n2_t = -2.0 * t_q * q - 2.0 * t_b * b - 4.0 * e * e_t;
  const double factor = 0.5 * e / n2;
  J->head<3>() = inv_n * (e_theta - factor * n2_theta);
  J->tail<2>() = inv_n * basis.transpose() * (e_t - factor * n2_t);
  return e * inv_n;
}

double robustCost(const BearingPairs& pairs, const TwoViewMotion& motion, double scale_rad) {
  double cost = 0.0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const double r = epipolarError(motion, pairs.a[i], pairs.b[i]) / scale_rad;
    cost += std::log1p(r * r);
  }
  return cost;
}

}  // namespace

double epipolarError(const TwoViewMotion& motion, const Eigen::Vector3d& a, const Eigen::Vector3d& b) {
  const Eigen::Vector3d q = motion.R_b_a * a;
  const double e = b.dot(motion.t_b_a.cross(q)), t_q = motion.t_b_a.dot(q), t_b = motion.t_b_a.dot(b);
  return e / std::sqrt(std::max(kMinNormalizer, 2.0 - t_q * t_q - t_b * t_b - 2.0 * e * e));
}

std::optional<Eigen::Quaterniond> robustRotation(const BearingPairs& pairs, double threshold_rad) {
  if (pairs.size() < 3) return std::nullopt;
  std::mt19937 random(kSeed);
  const double threshold2 = threshold_rad * threshold_rad;
  double best_score = -1.0;
  Eigen::Quaterniond best = Eigen::Quaterniond::Identity();
  for (int trial = 0; trial < kRotationTrials; ++trial) {
    const auto [i, j] = drawPair(&random, pairs.size());
    if (pairs.a[i].cross(pairs.a[j]).norm() < 0.05 || pairs.b[i].cross(pairs.b[j]).norm() < 0.05) continue;
    const Eigen::Matrix3d R = rotationFromPairs(pairs.a[i], pairs.a[j], pairs.b[i], pairs.b[j]).toRotationMatrix();
    double score = 0.0;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      score += std::max(0.0, 1.0 - (pairs.b[k] - R * pairs.a[k]).squaredNorm() / threshold2);
    }
    if (score > best_score) {
      best_score = score;
      best = Eigen::Quaterniond(R);
    }
  }
  if (best_score < 0.0) return std::nullopt;
  return refineRotation(pairs, best, threshold_rad);
}

std::optional<TwoViewMotion> robustTranslation(const BearingPairs& pairs, const Eigen::Quaterniond& R_b_a,
                                               double threshold_rad) {
  if (pairs.size() < 3) return std::nullopt;
  std::vector<Eigen::Vector3d> normals(pairs.size());  // of the planes that must hold t
  for (std::size_t i = 0; i < pairs.size(); ++i) normals[i] = (R_b_a * pairs.a[i]).cross(pairs.b[i]);
  std::mt19937 random(kSeed);
  const double threshold2 = threshold_rad * threshold_rad;
  TwoViewMotion motion{R_b_a, Eigen::Vector3d::UnitZ()}, best = motion;
  double best_score = -1.0;
  for (int trial = 0; trial < kTranslationTrials; ++trial) {
    const auto [i, j] = drawPair(&random, pairs.size());
    const Eigen::Vector3d t = normals[i].cross(normals[j]);
    if (!(t.norm() > 1e-14)) continue;
    motion.t_b_a = t.normalized();
    double score = 0.0;
    for (std::size_t k = 0; k < pairs.size(); ++k) {
      const double r = epipolarError(motion, pairs.a[k], pairs.b[k]);
      score += std::max(0.0, 1.0 - r * r / threshold2);
    }
    if (score > best_score) {
      best_score = score;
      best = motion;
    }
  }
  return best;
}

TwoViewMotion refineMotion(const BearingPairs& pairs, const TwoViewMotion& start, double scale_rad, double* cost) {
  TwoViewMotion motion = start;
  double value = robustCost(pairs, motion, scale_rad), damping = 1e-4;
  for (int iteration = 0; iteration < 30 && damping < 1e4; ++iteration) {
    Matrix5d H = Matrix5d::Identity() * 1e-9;
    Vector5d g = Vector5d::Zero();
    const TangentBasis basis = tangentBasis(motion.t_b_a);
    for (std::size_t i = 0; i < pairs.size(); ++i) {
      Vector5d J;
      const double r = epipolarError(motion, pairs.a[i], pairs.b[i], basis, &J);
      const double weight = 1.0 / (1.0 + r * r / (scale_rad * scale_rad));
      H += weight * J * J.transpose();
      g -= weight * r * J;
    }
    H.diagonal() *= 1.0 + damping;
    const Vector5d step = H.ldlt().solve(g);
    if (!step.allFinite()) break;
    const TwoViewMotion next{(expSo3(step.head<3>()) * motion.R_b_a).normalized(),
                             (motion.t_b_a + basis * step.tail<2>()).normalized()};
    const double next_value = robustCost(pairs, next, scale_rad);
    if (next_value > value) {
      damping *= 10.0;
      continue;
    }
    const bool converged = value - next_value < 1e-6 * value;
    motion = next;
    value = next_value;
    damping = std::max(1e-9, 0.1 * damping);
    if (converged) break;
  }
  if (cost != nullptr) *cost = value;
  return motion;
}

int depthConflicts(const BearingPairs& pairs, const TwoViewMotion& motion) {
  int forward = 0;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    const Eigen::Vector3d q = motion.R_b_a * pairs.a[i];
    forward += q.cross(pairs.b[i]).dot(q.cross(motion.t_b_a)) > 0.0;
  }
  return std::min(forward, static_cast<int>(pairs.size()) - forward);
}

std::optional<TwoViewMotion> essentialMotion(const BearingPairs& pairs, double threshold_rad) {
  std::vector<cv::Point2d> a, b;
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    if (pairs.a[i].z() < kMinBearingZ || pairs.b[i].z() < kMinBearingZ) continue;
    a.emplace_back(pairs.a[i].x() / pairs.a[i].z(), pairs.a[i].y() / pairs.a[i].z());
    b.emplace_back(pairs.b[i].x() / pairs.b[i].z(), pairs.b[i].y() / pairs.b[i].z());
  }
  if (a.size() < 8) return std::nullopt;
  try {
    cv::Mat inliers, R, t;
    const cv::Mat E = cv::findEssentialMat(a, b, 1.0, cv::Point2d(), cv::RANSAC, 0.99, threshold_rad, inliers);
    if (E.rows != 3 || E.cols != 3) return std::nullopt;  // several solutions stacked: no majority for any
    if (cv::recoverPose(E, a, b, R, t, 1.0, cv::Point2d(), inliers) < 5) return std::nullopt;
    Eigen::Matrix3d R_b_a;
    for (int i = 0; i < 9; ++i) R_b_a(i / 3, i % 3) = R.at<double>(i / 3, i % 3);
    const Eigen::Vector3d t_b_a(t.at<double>(0), t.at<double>(1), t.at<double>(2));
    return TwoViewMotion{Eigen::Quaterniond(R_b_a).normalized(), t_b_a.normalized()};
  } catch (const cv::Exception&) {
    return std::nullopt;  // degenerate points
  }
}

}  // namespace cocalib
