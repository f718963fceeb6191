#include "cocalib/initialization/shared_information.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>

namespace cocalib {

AlignmentParams AlignmentParams::open(const std::optional<Pose>& guess_T_imu_sensor) {
  constexpr double kGuessSigma_m = 0.1;
  AlignmentParams params;
  if (guess_T_imu_sensor) {
    params.lever_arm_guess = guess_T_imu_sensor->t;
    params.lever_arm_prior_m = kGuessSigma_m;
  }
  params.max_lever_arm_sigma_m = 2.0 * params.lever_arm_prior_m;  // an axis that only the prior holds is accepted
  return params;
}

SharedInformation priorInformation(const AlignmentParams& params) {
  SharedInformation prior;
  prior.H.diagonal().segment<3>(kAccelBiasRow).setConstant(1.0 / (params.accel_bias_sigma * params.accel_bias_sigma));
  const double lever_information = 1.0 / (params.lever_arm_prior_m * params.lever_arm_prior_m);
  prior.H.diagonal().segment<3>(kLeverRow).setConstant(lever_information);
  prior.b.segment<3>(kLeverRow) = lever_information * params.lever_arm_guess;
  return prior;
}

double SharedSolution::gravitySigma() const {
  const Eigen::Vector3d direction = gravity().normalized();
  return std::sqrt(std::max(0.0, direction.dot(covariance.topLeftCorner<3, 3>() * direction)));
}

SharedSolution solveFree(const SharedInformation& information) {
  const Eigen::LDLT<Matrix9d> ldlt(information.H);
  return {ldlt.solve(information.b), ldlt.solve(Matrix9d::Identity())};
}

SharedSolution solveWithGravity(const SharedInformation& information, double magnitude) {
  constexpr int kIterations = 6;  // converges quadratically from within a few degrees
  Eigen::Vector3d direction = information.gravityPart().normalized();
  SharedSolution solution;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    // x = x_0 + E z with z = (two tangent coordinates of gravity, bias, lever arm).
    Eigen::Matrix<double, 9, 8> E = Eigen::Matrix<double, 9, 8>::Zero();
    E.topLeftCorner<3, 2>() = magnitude * tangentBasis(direction);
    E.bottomRightCorner<6, 6>().setIdentity();
    Vector9d x_0 = Vector9d::Zero();
    x_0.head<3>() = magnitude * direction;
    const Eigen::Matrix<double, 8, 8> H = E.transpose() * information.H * E;
    const Eigen::LDLT<Eigen::Matrix<double, 8, 8>> ldlt(H);
    const Eigen::Matrix<double, 8, 1> z = ldlt.solve(E.transpose() * (information.b - information.H * x_0));
    solution.x = x_0 + E * z;
    solution.covariance = E * ldlt.solve(Eigen::Matrix<double, 8, 8>::Identity()) * E.transpose();
    direction = solution.gravity().normalized();
  }
  solution.x.head<3>() = magnitude * direction;
  return solution;
}

Eigen::Matrix3d honestLeverCovariance(const std::vector<SharedInformation>& parts, const SharedInformation& prior,
                                      double magnitude) {
  SharedInformation all = prior;
  for (const SharedInformation& part : parts) all += part;
  const Eigen::Matrix3d formal = solveWithGravity(all, magnitude).leverCovariance();
  constexpr std::size_t kFewestParts = 3;
  if (parts.size() < kFewestParts) return formal;

  std::vector<Eigen::Vector3d> levers;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();
  for (const SharedInformation& part : parts) {
    SharedInformation rest = all;
    rest -= part;
    levers.push_back(solveWithGravity(rest, magnitude).leverArm());
    mean += levers.back() / static_cast<double>(parts.size());
  }
  const double factor = static_cast<double>(parts.size() - 1) / static_cast<double>(parts.size());
  Eigen::Vector3d jackknife = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& lever : levers) jackknife += factor * (lever - mean).cwiseAbs2();
  const Eigen::Vector3d inflation = jackknife.cwiseQuotient(formal.diagonal()).cwiseMax(1.0).cwiseSqrt();
  return inflation.asDiagonal() * formal * inflation.asDiagonal();
}

std::string missingLeverMotion(const Eigen::Matrix3d& lever_covariance) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> eigen(lever_covariance);
  int axis = 0;
  eigen.eigenvectors().col(2).cwiseAbs().maxCoeff(&axis);
  std::array<char, 160> buffer{};
  std::snprintf(buffer.data(), buffer.size(),
                "translation along imu %c is known to %.2f m only: rotate back and forth about imu %c or %c",
                "xyz"[axis], std::sqrt(std::max(0.0, eigen.eigenvalues()[2])), "yzx"[axis], "zxy"[axis]);
  return buffer.data();
}

Eigen::Matrix<double, 3, 2> tangentBasis(const Eigen::Vector3d& direction) {
  Eigen::Matrix<double, 3, 2> basis;
  basis.col(0) = direction.unitOrthogonal();
  basis.col(1) = direction.cross(basis.col(0)).normalized();
  return basis;
}

}  // namespace cocalib
