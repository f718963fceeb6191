#include "cocalib/geometry/pose_covariance.h"

#include <gtest/gtest.h>

#include "numeric_jacobian.h"

namespace cocalib {
namespace {

TEST(PoseCovariance, OfInverseFollowsItsTangent) {
  const Pose T = {expSo3({0.4, -1.1, 2.3}), {0.3, -0.2, 1.5}};
  const Matrix6d J =
      test::numericPoseJacobian<6>(T, [&](const Pose& moved) { return moved.inverse().minus(T.inverse()); });
  Matrix6d A = Matrix6d::Identity();
  for (int i = 0; i < 36; ++i) A.data()[i] += 0.3 * std::sin(7.0 * i);
  const Matrix6d covariance = A * A.transpose();
  EXPECT_LT((covarianceOfInverse(T, covariance) - J * covariance * J.transpose()).cwiseAbs().maxCoeff(), 1e-6);
  // Twice inverted is where it began.
  EXPECT_LT((covarianceOfInverse(T.inverse(), covarianceOfInverse(T, covariance)) - covariance).cwiseAbs().maxCoeff(),
            1e-12);
}

}  // namespace
}  // namespace cocalib
