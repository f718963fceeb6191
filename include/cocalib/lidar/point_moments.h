#pragma once

#include <Eigen/Core>
#include <Eigen/Eigenvalues>

namespace cocalib {

/// Count, mean and scatter of a set of points, gathered one by one and joined without loss: all that a least-squares
/// plane needs to know of its points. Kept about the mean, so that coordinates far from the origin cost no digits.
struct PointMoments {
  double count = 0.0;
  Eigen::Vector3d mean = Eigen::Vector3d::Zero();     ///< [m]
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();  ///< sum of (p - mean)(p - mean)^T [m^2]

  void add(const Eigen::Vector3d& p) {
    count += 1.0;
    const Eigen::Vector3d step = p - mean;
    const Eigen::Vector3d share = step / count;
    mean += share;
    scatter.noalias() += (count - 1.0) * share * step.transpose();
  }

  void join(const PointMoments& other) {
    if (other.count <= 0.0) return;
    const double total = count + other.count;
    const Eigen::Vector3d step = other.mean - mean;
    scatter += other.scatter + count * other.count / total * step * step.transpose();
    mean += other.count / total * step;
    count = total;
  }

  /// Variance of the points along a unit direction, about their mean [m^2]. @pre count > 0
  double varianceAlong(const Eigen::Vector3d& direction) const { return direction.dot(scatter * direction) / count; }
};

/// Principal axes of a set of points.
struct PrincipalAxes {
  Eigen::Vector3d variances;  ///< ascending [m^2]
  Eigen::Matrix3d axes;       ///< unit columns in the order of `variances`; the first is the normal of the best plane
};

/// @pre moments.count > 0
inline PrincipalAxes principalAxes(const PointMoments& moments) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(moments.scatter / moments.count);
  return {solver.eigenvalues().cwiseMax(0.0), solver.eigenvectors()};
}

}  // namespace cocalib
