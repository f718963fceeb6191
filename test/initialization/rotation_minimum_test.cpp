#include "cocalib/initialization/rotation_minimum.h"

#include <gtest/gtest.h>

#include "cocalib/geometry/so3.h"
#include "cocalib/sim/random.h"

namespace cocalib {
namespace {

/// Sum of |b_i - R a_i|^2 over pairs of vectors.
RotationQuadratic alignment(const std::vector<Eigen::Vector3d>& a, const std::vector<Eigen::Vector3d>& b) {
  RotationQuadratic f;
  for (std::size_t i = 0; i < a.size(); ++i) {
    Eigen::Matrix<double, 3, 9> J;
    for (int j = 0; j < 3; ++j) J.middleCols<3>(3 * j) = a[i][j] * Eigen::Matrix3d::Identity();
    f.Q += J.transpose() * J;
    f.q += J.transpose() * b[i];
    f.c += b[i].squaredNorm();
  }
  return f;
}

TEST(RotationMinimum, FindsAnyRotation) {
  sim::Random random(1, sim::Random::Stream::kTexture, 0);
  for (int trial = 0; trial < 50; ++trial) {
    const Eigen::Quaterniond truth = expSo3(random.normal3() * 2.0);
    std::vector<Eigen::Vector3d> a, b;
    for (int i = 0; i < 10; ++i) {
      a.push_back(random.normal3());
      b.push_back(truth * a.back() + 1e-3 * random.normal3());
    }
    const RotationMinima found = minimizeOverRotations(alignment(a, b));
    EXPECT_LT(logSo3(Eigen::Quaterniond(found.R) * truth.conjugate()).norm(), 5e-3);
    EXPECT_LT(found.cost, 1e-3);
    EXPECT_GT(found.runner_up.value_or(1.0), found.cost + 0.1);
  }
}

TEST(RotationMinimum, GivesTheCurvatureToSecondOrder) {
  const std::vector<Eigen::Vector3d> a = {{1.0, 0.2, 0.0}, {0.0, 1.0, 0.5}, {0.3, 0.0, 0.1}};
  const std::vector<Eigen::Vector3d> b = {{0.9, 0.4, 0.1}, {0.1, 0.8, 0.7}, {0.2, 0.1, 0.0}};
  const RotationQuadratic f = alignment(a, b);
  const RotationMinima found = minimizeOverRotations(f);
  const double h = 1e-3;
  for (int i = 0; i < 3; ++i) {
    const Eigen::Vector3d d = h * Eigen::Vector3d::Unit(i);
    const double both = f(expSo3(d).toRotationMatrix() * found.R) + f(expSo3(-d).toRotationMatrix() * found.R);
    EXPECT_NEAR(0.5 * both - found.cost, h * h * found.curvature(i, i), 1e-4 * h * h);
  }
}

TEST(RotationMinimum, ShowsAnAxisThatStaysOpen) {
  const std::vector<Eigen::Vector3d> one = {Eigen::Vector3d::UnitZ()};
  const RotationMinima found = minimizeOverRotations(alignment(one, one));
  EXPECT_NEAR(found.cost, 0.0, 1e-9);
  EXPECT_NEAR(found.curvature(2, 2), 0.0, 1e-6);
  ASSERT_TRUE(found.runner_up);
  EXPECT_NEAR(*found.runner_up, 0.0, 1e-9);
}

}  // namespace
}  // namespace cocalib
