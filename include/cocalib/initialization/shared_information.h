#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <string>
#include <vector>

#include "cocalib/initialization/alignment.h"

namespace cocalib {

using Vector9d = Eigen::Matrix<double, 9, 1>;
using Matrix9d = Eigen::Matrix<double, 9, 9>;

/// What measurements say about x = (gravity vector, accelerometer bias, lever arm) after everything that belongs to one
/// chunk only is eliminated: minimise x^T H x / 2 - b^T x.
struct SharedInformation {
  Matrix9d H = Matrix9d::Zero();
  Vector9d b = Vector9d::Zero();

  SharedInformation& operator+=(const SharedInformation& other) {
    H += other.H;
    b += other.b;
    return *this;
  }
  SharedInformation& operator-=(const SharedInformation& other) {
    H -= other.H;
    b -= other.b;
    return *this;
  }
  Eigen::Vector3d gravityPart() const { return H.ldlt().solve(b).head<3>(); }
};

constexpr int kGravityRow = 0, kAccelBiasRow = 3, kLeverRow = 6;

/// Priors of accelerometer bias (about zero) and lever arm (about its guess).
SharedInformation priorInformation(const AlignmentParams& params);

struct SharedSolution {
  Vector9d x = Vector9d::Zero();
  Matrix9d covariance = Matrix9d::Zero();

  Eigen::Vector3d gravity() const { return x.segment<3>(kGravityRow); }
  Eigen::Vector3d accelBias() const { return x.segment<3>(kAccelBiasRow); }
  Eigen::Vector3d leverArm() const { return x.segment<3>(kLeverRow); }
  Eigen::Matrix3d leverCovariance() const { return covariance.block<3, 3>(kLeverRow, kLeverRow); }
  double gravitySigma() const;  ///< of gravity's magnitude [m/s^2]
};

/// Least squares with a free gravity vector.
SharedSolution solveFree(const SharedInformation& information);

/// Least squares with gravity's magnitude given: its direction moves on the sphere, from the free solution's.
SharedSolution solveWithGravity(const SharedInformation& information, double magnitude);

/// 1 sigma of the lever arm: the formal one, or that from leaving out one chunk after the other if it is larger (errors
/// that last, of attitude for one, are not in the formal one). `parts` are the chunks, `prior` is always kept.
Eigen::Matrix3d honestLeverCovariance(const std::vector<SharedInformation>& parts, const SharedInformation& prior,
                                      double magnitude);

/// In words for the user: which part of the lever arm is least certain, and which rotation shows it.
std::string missingLeverMotion(const Eigen::Matrix3d& lever_covariance);

/// Two unit vectors that are orthogonal to `direction` and to each other.
Eigen::Matrix<double, 3, 2> tangentBasis(const Eigen::Vector3d& direction);

}  // namespace cocalib
