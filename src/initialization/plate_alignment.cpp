#include "cocalib/initialization/plate_alignment.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <Eigen/Dense>
#include <Eigen/SVD>
#include <cmath>

namespace cocalib {
namespace {

constexpr double kCentreWeight_per_m = 1.0;  // in the rotation: a metre between middles tells as much as a normal
constexpr double kOffsetSigma_m = 0.01;      // of a plane's offset,
constexpr double kCentreSigma_m = 0.05;      // and of a plate's middle, which the outline gives
constexpr double kEdgeFloor_m = 0.005;       // of a crossing beside the beams' spacing: divergence, corners' rounding
constexpr double kRobustSigmas = 2.0;

/// Pose near a start: the tangent at it, so that the solver needs no manifold.
template <typename T>
Eigen::Matrix<T, 3, 1> toCamera(const Pose& start_T_L_C, const T* tangent, const Eigen::Matrix<T, 3, 1>& p_L) {
  using Vector = Eigen::Matrix<T, 3, 1>;
  const Vector shifted = p_L - start_T_L_C.t.cast<T>() - Eigen::Map<const Vector>(tangent);
  const T back[3] = {-tangent[3], -tangent[4], -tangent[5]};
  Vector turned;
  ceres::AngleAxisRotatePoint(back, shifted.data(), turned.data());
  return start_T_L_C.q.conjugate().cast<T>() * turned;
}

/// Distance of one return to the camera's plate.
struct PointCost {
  Pose start_T_L_C, T_P_C;
  Eigen::Vector3d p_L;
  double sigma_m;

  template <typename T>
  bool operator()(const T* tangent, const T* bias, T* residual) const {
    const Eigen::Matrix<T, 3, 1> p = p_L.cast<T>() + p_L.normalized().cast<T>() * bias[0];
    const Eigen::Matrix<T, 3, 1> p_C = toCamera(start_T_L_C, tangent, p);
    residual[0] = (T_P_C.q.cast<T>() * p_C + T_P_C.t.cast<T>()).z() / T(sigma_m);
    return true;
  }
};

/// Distance to the nearest side of the plate of the place where a crossing's beam meets the camera's plate.
struct EdgeCost {
  Pose start_T_L_C, T_P_C;
  Eigen::Vector3d bearing_L;
  Eigen::Vector2d half_size_m;
  double sigma_m;

  template <typename T>
  bool operator()(const T* tangent, T* residual) const {
    using Vector = Eigen::Matrix<T, 3, 1>;
    const Vector zero = Vector::Zero(), along = bearing_L.cast<T>();
    const Vector origin = T_P_C.q.cast<T>() * toCamera(start_T_L_C, tangent, zero) + T_P_C.t.cast<T>();
    const Vector ahead = T_P_C.q.cast<T>() * toCamera(start_T_L_C, tangent, along) + T_P_C.t.cast<T>();
    const Vector ray = ahead - origin;
    if (ray.z() == T(0.0)) return false;
    const Vector hit = origin - ray * (origin.z() / ray.z());
    using std::abs;
    const T x = abs(hit.x()) - T(half_size_m.x()), y = abs(hit.y()) - T(half_size_m.y());
    residual[0] = (x > y ? x : y) / T(sigma_m);
    return true;
  }
};

void addPair(const PlatePair& pair, const Eigen::Vector2d& half_size, const Pose& start,
             const LidarCameraInitializerParams& params, double* tangent, double* bias, ceres::Problem* problem) {
  const Pose T_P_C = pair.T_C_P.inverse();
  for (const Eigen::Vector3d& p : pair.plate->points_L) {
    problem->AddResidualBlock(
        new ceres::AutoDiffCostFunction<PointCost, 1, 6, 1>(new PointCost{start, T_P_C, p, params.range_noise_m}),
        new ceres::HuberLoss(kRobustSigmas), tangent, bias);
  }
  const double half_gap = 0.5 * pair.plate->edge_spacing_rad * pair.plate->centre_L.norm();
  const double sigma = std::hypot(half_gap / std::sqrt(3.0), kEdgeFloor_m);  // of a uniform distribution over the gap
  for (const Eigen::Vector3d& bearing : pair.plate->edge_bearings_L) {
    problem->AddResidualBlock(
        new ceres::AutoDiffCostFunction<EdgeCost, 1, 6>(new EdgeCost{start, T_P_C, bearing, half_size, sigma}),
        new ceres::CauchyLoss(kRobustSigmas), tangent);
  }
}

/// RMS of the points' distances and of the crossings', at the fit.
void measureResiduals(const std::vector<PlatePair>& pairs, const Eigen::Vector2d& half_size, PlateFit* fit) {
  double plane_sum = 0.0, edge_sum = 0.0;
  std::size_t points = 0, edges = 0;
  const double zero[6] = {};
  for (const PlatePair& pair : pairs) {
    const Pose T_P_C = pair.T_C_P.inverse();
    double residual = 0.0;
    for (const Eigen::Vector3d& p : pair.plate->points_L) {
      PointCost{fit->T_L_C, T_P_C, p, 1.0}(zero, &fit->range_bias_m, &residual);
      plane_sum += residual * residual;
      ++points;
    }
    for (const Eigen::Vector3d& bearing : pair.plate->edge_bearings_L) {
      if (!EdgeCost{fit->T_L_C, T_P_C, bearing, half_size, 1.0}(zero, &residual)) continue;
      edge_sum += residual * residual;
      ++edges;
    }
  }
  if (points > 0) fit->plane_rms_m = std::sqrt(plane_sum / static_cast<double>(points));
  if (edges > 0) fit->edge_rms_m = std::sqrt(edge_sum / static_cast<double>(edges));
}

}  // namespace

Pose alignPlates(const std::vector<PlatePair>& pairs, bool use_centres) {
  const auto count = static_cast<double>(pairs.size());
  Eigen::Vector3d mean_C = Eigen::Vector3d::Zero(), mean_L = mean_C;
  for (const PlatePair& pair : pairs) {
    mean_C += pair.T_C_P.t / count;
    mean_L += pair.plate->centre_L / count;
  }
  Eigen::Matrix3d cross = Eigen::Matrix3d::Zero();
  for (const PlatePair& pair : pairs) {
    cross += pair.plate->plane_L.normal * pair.normal_C().transpose();
    if (use_centres) {
      cross += kCentreWeight_per_m * (pair.plate->centre_L - mean_L) * (pair.T_C_P.t - mean_C).transpose();
    }
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(cross, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const double handedness = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  const Eigen::Matrix3d R =
      svd.matrixU() * Eigen::Vector3d(1.0, 1.0, handedness).asDiagonal() * svd.matrixV().transpose();

  Eigen::Matrix3d A = Eigen::Matrix3d::Zero();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  for (const PlatePair& pair : pairs) {
    const Eigen::Vector3d& n = pair.plate->plane_L.normal;
    const Eigen::Vector3d turned = R * pair.T_C_P.t;
    const double plane_weight = 1.0 / (kOffsetSigma_m * kOffsetSigma_m);
    const double centre_weight = 1.0 / (kCentreSigma_m * kCentreSigma_m);
    A += plane_weight * n * n.transpose() + centre_weight * Eigen::Matrix3d::Identity();
    b += plane_weight * (pair.plate->plane_L.offset_m - n.dot(turned)) * n +
         centre_weight * (pair.plate->centre_L - turned);
  }
  return {Eigen::Quaterniond(R).normalized(), A.ldlt().solve(b)};
}

PlateFit refinePlates(const std::vector<PlatePair>& pairs, const Eigen::Vector2d& plate_size_m, const Pose& start_T_L_C,
                      const LidarCameraInitializerParams& params) {
  Vector6d tangent = Vector6d::Zero();
  double bias = 0.0;
  ceres::Problem problem;
  for (const PlatePair& pair : pairs) {
    addPair(pair, 0.5 * plate_size_m, start_T_L_C, params, tangent.data(), &bias, &problem);
  }
  if (problem.HasParameterBlock(&bias) && !params.estimate_range_bias) problem.SetParameterBlockConstant(&bias);
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_NORMAL_CHOLESKY;
  options.max_num_iterations = 30;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);

  PlateFit fit;
  fit.T_L_C = start_T_L_C.plus(tangent);
  fit.range_bias_m = bias;
  measureResiduals(pairs, 0.5 * plate_size_m, &fit);
  return fit;
}

}  // namespace cocalib
