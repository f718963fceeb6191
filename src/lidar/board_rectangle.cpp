#include "cocalib/lidar/board_rectangle.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace cocalib::plate {
namespace {

constexpr int kMaxIterations = 15;
constexpr int kMaxAttempts = 5;          // at a step that makes the sum smaller
constexpr double kConvergedStep = 2e-5;  // [m, rad]: far below what a lidar can tell
constexpr double kMaxStep = 0.1;         // [m, rad]: the distance is linear only near
constexpr double kFar = 12.0;            // beyond this the logistic is flat to 1e-5

double softplus(double z) {
  if (z > kFar) return z;
  return z < -kFar ? 0.0 : std::log1p(std::exp(z));
}

/// Rectangle with its rotation worked out once.
struct Turned {
  explicit Turned(const Rectangle& rectangle)
      : centre(rectangle.centre),
        half(rectangle.half_m),
        c(std::cos(rectangle.angle_rad)),
        s(std::sin(rectangle.angle_rad)) {}
  Eigen::Vector2d local(const Eigen::Vector2d& p) const {
    const Eigen::Vector2d d = p - centre;
    return {c * d.x() + s * d.y(), -s * d.x() + c * d.y()};
  }
  Eigen::Vector2d centre, half;
  double c, s;
};

/// What is minimised, for points that should lie inside (side 1) or outside (side -1).
double lossOf(const std::vector<Eigen::Vector2d>& points, double side, double scale_m, const Turned& rectangle) {
  double loss = 0.0;
  for (const auto& p : points) {
    const Eigen::Vector2d beyond = rectangle.local(p).cwiseAbs() - rectangle.half;
    loss += softplus(side * std::max(beyond.x(), beyond.y()) / scale_m);
  }
  return loss;
}

/// Adds curvature and gradient over the first N of (centre, angle, half lengths).
template <int N>
void accumulate(const std::vector<Eigen::Vector2d>& points, double side, double scale_m, const Turned& rectangle,
                Eigen::Matrix<double, N, N>* H, Eigen::Matrix<double, N, 1>* g) {
  for (const auto& p : points) {
    const Eigen::Vector2d q = rectangle.local(p);
    const Eigen::Vector2d beyond = q.cwiseAbs() - rectangle.half;
    const int axis = beyond.x() > beyond.y() ? 0 : 1;
    const double z = side * beyond[axis] / scale_m;
    if (z < -kFar) continue;
    const double sign = q[axis] < 0.0 ? -1.0 : 1.0;
    Eigen::Matrix<double, 5, 1> gradient;  // of the signed distance
    if (axis == 0) {
      gradient << -sign * rectangle.c, -sign * rectangle.s, sign * q.y(), -1.0, 0.0;
    } else {
      gradient << sign * rectangle.s, -sign * rectangle.c, -sign * q.x(), 0.0, -1.0;
    }
    const double probability = 1.0 / (1.0 + std::exp(-z));
    const Eigen::Matrix<double, N, 1> J = side / scale_m * gradient.template head<N>();
    *g += probability * J;
    *H += (probability * (1.0 - probability)) * (J * J.transpose());
  }
}

template <int N>
Rectangle moved(const Rectangle& from, const Eigen::Matrix<double, N, 1>& step) {
  Rectangle to = from;
  to.centre += step.template head<2>();
  to.angle_rad += step[2];
  if (N == 5) to.half_m = (to.half_m + step.template tail<2>()).cwiseMax(0.02);
  return to;
}

template <int N>
double minimise(const std::vector<Eigen::Vector2d>& on, const std::vector<Eigen::Vector2d>& off, double scale_m,
                Rectangle* rectangle) {
  const auto totalLoss = [&](const Rectangle& r) {
    const Turned turned(r);
    return lossOf(on, 1.0, scale_m, turned) + lossOf(off, -1.0, scale_m, turned);
  };
  double loss = totalLoss(*rectangle), damping = 1e-2;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    Eigen::Matrix<double, N, N> H = Eigen::Matrix<double, N, N>::Zero();
    Eigen::Matrix<double, N, 1> g = Eigen::Matrix<double, N, 1>::Zero(), step = g;
    const Turned turned(*rectangle);
    accumulate<N>(on, 1.0, scale_m, turned, &H, &g);
    accumulate<N>(off, -1.0, scale_m, turned, &H, &g);
    bool improved = false;
    for (int attempt = 0; attempt < kMaxAttempts && !improved; ++attempt) {
      // The absolute part holds a side that nothing lies near.
      Eigen::Matrix<double, N, N> A = H;
      A.diagonal() += damping * H.diagonal() + Eigen::Matrix<double, N, 1>::Ones();
      step = -A.ldlt().solve(g);
      step = step.cwiseMax(-kMaxStep).cwiseMin(kMaxStep).eval();
      const Rectangle candidate = moved<N>(*rectangle, step);
      const double candidate_loss = totalLoss(candidate);
      improved = candidate_loss < loss;
      if (improved) {
        *rectangle = candidate;
        loss = candidate_loss;
        damping = std::max(1e-6, damping * 0.2);
      } else {
        damping = std::max(1e-2, damping) * 10.0;
      }
    }
    if (!improved || step.cwiseAbs().maxCoeff() < kConvergedStep) break;
  }
  return loss;
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
  return fit_size ? minimise<5>(on, off, scale_m, rectangle) : minimise<3>(on, off, scale_m, rectangle);
}

}  // namespace cocalib::plate
