#include "cocalib/initialization/rotation_minimum.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <vector>

#include "cocalib/geometry/so3.h"

namespace cocalib {
namespace {

constexpr int kMaxIterations = 30;
constexpr double kConverged_rad = 1e-9;
constexpr double kSame_rad = 0.2;  // minima closer than this are one

using Vector9d = Eigen::Matrix<double, 9, 1>;

Eigen::Map<const Vector9d> entries(const Eigen::Matrix3d& R) { return Eigen::Map<const Vector9d>(R.data()); }

/// f(Exp(d) R) = f(R) + 2 g^T d + d^T H d to second order.
struct Expansion {
  Eigen::Vector3d g;
  Eigen::Matrix3d H;
};

Expansion expand(const RotationQuadratic& f, const Eigen::Matrix3d& R) {
  Eigen::Matrix<double, 9, 3> G;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Matrix3d turned = hat(Eigen::Vector3d::Unit(i)) * R;
    G.col(i) = entries(turned);
  }
  const Vector9d w = f.Q * entries(R) - f.q;
  // Second order of Exp(d) R is d^ d^ R / 2, and d^ d^ = d d^T - d^T d I.
  const Eigen::Matrix3d M = R * Eigen::Map<const Eigen::Matrix3d>(w.data()).transpose();
  Expansion result{G.transpose() * w, G.transpose() * f.Q * G + 0.5 * (M + M.transpose())};
  result.H.diagonal().array() -= M.trace();
  return result;
}

std::vector<Eigen::Matrix3d> cubeRotations() {
  std::vector<Eigen::Matrix3d> rotations;
  for (int first = 0; first < 3; ++first) {
    for (int second = 0; second < 3; ++second) {
      if (second == first) continue;
      for (const double a : {-1.0, 1.0}) {
        for (const double b : {-1.0, 1.0}) {
          Eigen::Matrix3d R;
          R.col(0) = a * Eigen::Vector3d::Unit(first);
          R.col(1) = b * Eigen::Vector3d::Unit(second);
          R.col(2) = R.col(0).cross(R.col(1));
          rotations.push_back(R);
        }
      }
    }
  }
  return rotations;
}

Eigen::Matrix3d descend(const RotationQuadratic& f, Eigen::Matrix3d R) {
  double cost = f(R), damping = 1e-3;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const Expansion at = expand(f, R);
    const double scale = at.H.cwiseAbs().maxCoeff() + 1e-12;
    Eigen::Vector3d step = Eigen::Vector3d::Zero();
    for (;; damping *= 4.0) {
      const Eigen::LLT<Eigen::Matrix3d> llt(at.H + damping * scale * Eigen::Matrix3d::Identity());
      if (llt.info() == Eigen::Success) {
        step = -llt.solve(at.g);
        const Eigen::Matrix3d candidate = expSo3(step).toRotationMatrix() * R;
        const double value = f(candidate);
        if (value <= cost) {
          R = candidate;
          cost = value;
          damping = std::max(0.1 * damping, 1e-9);
          break;
        }
      }
      if (damping > 1e9) return R;
    }
    if (step.norm() < kConverged_rad) break;
  }
  return R;
}

}  // namespace

double RotationQuadratic::operator()(const Eigen::Matrix3d& R) const {
  const auto r = entries(R);
  return r.dot(Q * r) - 2.0 * q.dot(r) + c;
}

RotationMinima minimizeOverRotations(const RotationQuadratic& f) {
  static const std::vector<Eigen::Matrix3d> starts = cubeRotations();
  std::vector<Eigen::Matrix3d> found;
  for (const Eigen::Matrix3d& start : starts) found.push_back(descend(f, start));
  RotationMinima result;
  result.R = *std::min_element(found.begin(), found.end(), [&](const auto& a, const auto& b) { return f(a) < f(b); });
  result.cost = f(result.R);
  result.curvature = expand(f, result.R).H;
  for (const Eigen::Matrix3d& R : found) {
    const Eigen::Matrix3d difference = R * result.R.transpose();
    if (logSo3(Eigen::Quaterniond(difference)).norm() < kSame_rad) continue;
    result.runner_up = std::min(result.runner_up.value_or(f(R)), f(R));
  }
  return result;
}

}  // namespace cocalib
