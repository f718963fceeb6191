#include "cocalib/geometry/so3.h"

#include <gtest/gtest.h>

#include "cocalib/geometry/pose.h"
#include "cocalib/geometry/time.h"

namespace cocalib {
namespace {

TEST(So3, LogInvertsExpFromTinyToNearlyPi) {
  for (const double angle : {0.0, 1e-12, 1e-7, 1e-4, 0.5, 3.0, 3.14159}) {
    const Eigen::Vector3d phi = angle * Eigen::Vector3d(1.0, -2.0, 0.5).normalized();
    EXPECT_LT((logSo3(expSo3(phi)) - phi).norm(), 1e-9) << angle;
  }
}

TEST(So3, LogTakesTheShorterWay) {
  Eigen::Quaterniond q = expSo3({0.1, 0.2, 0.3});
  q.coeffs() *= -1.0;
  EXPECT_LT((logSo3(q) - Eigen::Vector3d(0.1, 0.2, 0.3)).norm(), 1e-12);
}

TEST(So3, LeftJacobianMatchesCentralDifferences) {
  for (const Eigen::Vector3d& phi : {Eigen::Vector3d(0.3, -0.8, 1.1), Eigen::Vector3d(2e-4, 1e-4, -3e-4)}) {
    Eigen::Matrix3d numeric;
    for (int i = 0; i < 3; ++i) {
      const Eigen::Vector3d d = 1e-6 * Eigen::Vector3d::Unit(i);
      numeric.col(i) = logSo3(expSo3(phi + d) * expSo3(phi - d).conjugate()) / 2e-6;
    }
    EXPECT_LT((leftJacobianSo3(phi) - numeric).norm(), 1e-8);
    EXPECT_LT((inverseLeftJacobianSo3(phi) * leftJacobianSo3(phi) - Eigen::Matrix3d::Identity()).norm(), 1e-10);
    EXPECT_LT((rightJacobianSo3(phi) - leftJacobianSo3(phi).transpose()).norm(), 1e-12);
  }
}

TEST(Pose, MinusInvertsPlus) {
  const Pose T{expSo3({0.4, -1.1, 2.3}), {3.0, -2.0, 0.5}};
  Vector6d delta;
  delta << 0.1, -0.2, 0.3, 0.2, 0.1, -0.4;
  EXPECT_LT((T.plus(delta).minus(T) - delta).norm(), 1e-12);
}

TEST(Pose, ComposesLikeItsMatrices) {
  const Pose T_A_B{expSo3({0.4, -1.1, 2.3}), {3.0, -2.0, 0.5}}, T_B_C{expSo3({1.0, 0.2, 0.1}), {0.1, 0.2, -0.3}};
  const Eigen::Vector3d p_C(1.0, 2.0, 3.0);
  EXPECT_LT(((T_A_B * T_B_C) * p_C - T_A_B * (T_B_C * p_C)).norm(), 1e-12);
  EXPECT_LT((T_A_B.inverse() * (T_A_B * p_C) - p_C).norm(), 1e-12);
}

TEST(Time, RoundsToTheNanosecond) {
  EXPECT_EQ(toNs(1.5e-9), 2);
  EXPECT_EQ(toNs(-0.001), -1000000);
  EXPECT_DOUBLE_EQ(toSeconds(2500000000), 2.5);
}

}  // namespace
}  // namespace cocalib
