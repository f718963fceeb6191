#include "cocalib/lidar/board_rectangle.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace cocalib::plate {
namespace {

using Vector5d = Eigen::Matrix<double, 5, 1>;
using Matrix5d = Eigen::Matrix<double, 5, 5>;

constexpr int kMaxIterations = 25;
constexpr double kConvergedStep = 1e-5;  // [m, rad]: far below what a lidar can tell

double softplus(double z) { return z > 0.0 ? z + std::log1p(std::exp(-z)) : std::log1p(std::exp(z)); }

double totalLoss(const std::vector<Eigen::Vector2d>& on, const std::vector<Eigen::Vector2d>& off, double scale_m,
                 const Rectangle& rectangle) {
  double loss = 0.0;
  for (const auto& p : on) loss += softplus(rectangle.signedDistance(p) / scale_m);
  for (const auto& p : off) loss += softplus(-rectangle.signedDistance(p) / scale_m);
  return loss;
}

/// Gradient of the signed distance over (centre, angle, half lengths).
Vector5d distanceGradient(const Rectangle& rectangle, const Eigen::Vector2d& p) {
  const Eigen::Vector2d q = rectangle.local(p);
  const double c = std::cos(rectangle.angle_rad), s = std::sin(rectangle.angle_rad);
  Vector5d gradient;
  if (std::abs(q.x()) - rectangle.half_m.x() > std::abs(q.y()) - rectangle.half_m.y()) {
    const double sign = q.x() < 0.0 ? -1.0 : 1.0;
    gradient << -sign * c, -sign * s, sign * q.y(), -1.0, 0.0;
  } else {
    const double sign = q.y() < 0.0 ? -1.0 : 1.0;
    gradient << sign * s, -sign * c, -sign * q.x(), 0.0, -1.0;
  }
  return gradient;
}

void accumulate(const std::vector<Eigen::Vector2d>& points, double side, double scale_m, const Rectangle& rectangle,
                Matrix5d* H, Vector5d* g) {
  for (const auto& p : points) {
    const double z = side * rectangle.signedDistance(p) / scale_m;
    if (z < -12.0) continue;  // well on its side: weight under 1e-5
    const double probability = 1.0 / (1.0 + std::exp(-z));
    const Vector5d J = side / scale_m * distanceGradient(rectangle, p);
    *g += probability * J;
    *H += probability * (1.0 - probability) * J * J.transpose();
  }
}

Rectangle moved(const Rectangle& from, const Vector5d& step) {
  Rectangle to = from;
  to.centre += step.head<2>();
  to.angle_rad += step[2];
  to.half_m = (to.half_m + step.tail<2>()).cwiseMax(0.02);
  return to;
}

}  // namespace

Eigen::Vector2d Rectangle::local(const Eigen::Vector2d& p) const {
  const double c = std::cos(angle_rad), s = std::sin(angle_rad);
  const Eigen::Vector2d d = p - centre;
  return {c * d.x() + s * d.y(), -s * d.x() + c * d.y()};
}

double Rectangle::signedDistance(const Eigen::Vector2d& p) const {
  const Eigen::Vector2d q = local(p);
  return std::max(std::abs(q.x()) - half_m.x(), std::abs(q.y()) - half_m.y());
}

double fitRectangle(const std::vector<Eigen::Vector2d>& on, const std::vector<Eigen::Vector2d>& off, bool fit_size,
                    double scale_m, Rectangle* rectangle) {
  double loss = totalLoss(on, off, scale_m, *rectangle);
  double damping = 1e-2;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    Matrix5d H = Matrix5d::Zero();
    Vector5d g = Vector5d::Zero();
    accumulate(on, 1.0, scale_m, *rectangle, &H, &g);
    accumulate(off, -1.0, scale_m, *rectangle, &H, &g);
    const int n = fit_size ? 5 : 3;
    bool improved = false;
    Vector5d step = Vector5d::Zero();
    for (int attempt = 0; attempt < 6 && !improved; ++attempt) {
      // The absolute part holds a side that nothing lies near.
      Eigen::MatrixXd A = H.topLeftCorner(n, n);
      A.diagonal() += damping * A.diagonal() + Eigen::VectorXd::Constant(n, 1.0);
      step.head(n) = -A.ldlt().solve(g.head(n));
      step = step.cwiseMax(-0.1).cwiseMin(0.1);
      const Rectangle candidate = moved(*rectangle, step);
      const double candidate_loss = totalLoss(on, off, scale_m, candidate);
      improved = candidate_loss < loss;
      if (improved) {
        *rectangle = candidate;
        loss = candidate_loss;
        damping = std::max(1e-6, damping * 0.2);
      } else {
        damping = std::max(1e-3, damping) * 10.0;
      }
    }
    if (!improved || step.head(n).cwiseAbs().maxCoeff() < kConvergedStep) break;
  }
  return loss;
}

}  // namespace cocalib::plate
