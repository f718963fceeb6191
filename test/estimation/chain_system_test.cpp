#include "cocalib/estimation/chain_system.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <random>

namespace cocalib {
namespace {

constexpr int kNodes = 40, kGlobals = 30;

/// A random well-posed problem, as a ChainSystem and as one dense matrix.
struct Problem {
  ChainSystem system{kNodes, kGlobals};
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(15 * kNodes + kGlobals, 15 * kNodes + kGlobals);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(15 * kNodes + kGlobals);

  /// Adds a random factor over nodes i and j and all globals.
  void addFactor(int i, int j, std::mt19937* random) {
    std::normal_distribution<double> normal;
    const auto draw = [&](int cols) { return Eigen::MatrixXd::NullaryExpr(20, cols, [&] { return normal(*random); }); };
    const Eigen::MatrixXd J_i = draw(15), J_j = draw(15), J_g = draw(kGlobals);
    const Eigen::VectorXd r = draw(1);
    system.diagonal(i) += J_i.transpose() * J_i;
    system.diagonal(j) += J_j.transpose() * J_j;
    system.offDiagonal(i, j) += J_i.transpose() * J_j;
    system.coupling(i) += J_i.transpose() * J_g;
    system.coupling(j) += J_j.transpose() * J_g;
    system.gradient(i) += J_i.transpose() * r;
    system.gradient(j) += J_j.transpose() * r;
    system.H_global += J_g.transpose() * J_g;
    system.b_global += J_g.transpose() * r;
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(20, H.cols());
    J.middleCols(15 * i, 15) = J_i;
    J.middleCols(15 * j, 15) = J_j;
    J.rightCols(kGlobals) = J_g;
    H += J.transpose() * J;
    b += J.transpose() * r;
  }
};

Problem chainWithTracks() {
  std::mt19937 random(11);
  Problem problem;
  for (int repeat = 0; repeat < 2; ++repeat) {
    for (int i = 0; i + 1 < kNodes; ++i) problem.addFactor(i, i + 1, &random);
  }
  for (int i = 0; i + 9 < kNodes; i += 3) problem.addFactor(i, i + 9, &random);  // as feature tracks couple
  return problem;
}

TEST(ChainSystem, SolvesAsTheDenseProblem) {
  const Problem problem = chainWithTracks();
  ChainSystem::Step step;
  ASSERT_TRUE(problem.system.solve(0.0, &step));
  const Eigen::VectorXd dense = -problem.H.ldlt().solve(problem.b);
  const double scale = dense.norm();
  for (int i = 0; i < kNodes; ++i) {
    EXPECT_LT((step.nodes[static_cast<std::size_t>(i)] - dense.segment<15>(15 * i)).norm(), 1e-7 * scale);
  }
  EXPECT_LT((step.globals - dense.tail(kGlobals)).norm(), 1e-7 * scale);
  EXPECT_NEAR(step.predicted_decrease, -0.5 * problem.b.dot(dense), 1e-6 * step.predicted_decrease);
}

TEST(ChainSystem, DampingShortensStepsAndInformsOfNothing) {
  const Problem problem = chainWithTracks();
  ChainSystem damped = problem.system;
  damped.node_damping.segment<3>(6).setConstant(50.0);
  damped.global_damping.setConstant(20.0);
  ChainSystem::Step step;
  ASSERT_TRUE(damped.solve(0.0, &step));
  Eigen::MatrixXd H = problem.H;
  for (int i = 0; i < kNodes; ++i) H.diagonal().segment<3>(15 * i + 6).array() += 50.0;
  H.diagonal().tail(kGlobals).array() += 20.0;
  const Eigen::VectorXd dense = -H.ldlt().solve(problem.b);
  for (int i = 0; i < kNodes; ++i) {
    EXPECT_LT((step.nodes[static_cast<std::size_t>(i)] - dense.segment<15>(15 * i)).norm(), 1e-7 * dense.norm());
  }
  EXPECT_LT((step.globals - dense.tail(kGlobals)).norm(), 1e-7 * dense.norm());

  Eigen::MatrixXd H_damped, H_own;
  Eigen::VectorXd b_damped, b_own;
  ASSERT_TRUE(damped.globalInformation(&H_damped, &b_damped));
  ASSERT_TRUE(problem.system.globalInformation(&H_own, &b_own));
  EXPECT_EQ(H_damped, H_own);
  EXPECT_EQ(b_damped, b_own);
}

TEST(ChainSystem, GlobalInformationIsTheSchurComplement) {
  const Problem problem = chainWithTracks();
  Eigen::MatrixXd H;
  Eigen::VectorXd b;
  ASSERT_TRUE(problem.system.globalInformation(&H, &b));
  const Eigen::MatrixXd inverse = problem.H.inverse().bottomRightCorner(kGlobals, kGlobals);
  EXPECT_TRUE(H.inverse().isApprox(inverse, 1e-6));
}

TEST(ChainSystem, AMarginalSaysWhatTheEliminatedNodesSaid) {
  // Factors of the first 12 nodes only, and then all: marginal of the first part + the rest = the whole.
  std::mt19937 random(5);
  Problem front, whole;
  for (int repeat = 0; repeat < 3; ++repeat) {
    for (int i = 0; i < 12; ++i) {
      std::mt19937 same = random;
      front.addFactor(i, i + 1, &random);
      whole.addFactor(i, i + 1, &same);
    }
  }
  ChainSystem::Marginal marginal;
  ASSERT_TRUE(front.system.marginalizeFront(12, &marginal));
  ASSERT_EQ(marginal.kept, std::vector<int>{12});
  const Eigen::Index kept = 15 + kGlobals;
  Eigen::MatrixXd rest = Eigen::MatrixXd::Zero(kept, kept);
  const Eigen::Index first = 15 * 12;
  const Eigen::MatrixXd A = front.H.topLeftCorner(first, first);
  Eigen::MatrixXd B(first, kept);
  B << front.H.block(0, first, first, 15), front.H.topRightCorner(first, kGlobals);
  rest << front.H.block(first, first, 15, 15), front.H.block(first, 15 * kNodes, 15, kGlobals),
      front.H.block(15 * kNodes, first, kGlobals, 15), front.H.bottomRightCorner(kGlobals, kGlobals);
  const Eigen::MatrixXd schur = rest - B.transpose() * A.ldlt().solve(B);
  EXPECT_TRUE(marginal.H.isApprox(schur, 1e-6));
}

TEST(ChainSystem, RefusesAnIndefiniteProblem) {
  ChainSystem system(3, 4);
  system.diagonal(1)(0, 0) = -1.0;
  ChainSystem::Step step;
  EXPECT_FALSE(system.solve(0.0, &step));
}

TEST(ChainSystem, CountsOfNodesThatFillAnUpdateExactlyAreFine) {
  ChainSystem system(32, 4);
  for (int i = 0; i < 32; ++i) system.diagonal(i).setIdentity();
  system.H_global.setIdentity();
  ChainSystem::Step step;
  EXPECT_TRUE(system.solve(0.0, &step));
}

}  // namespace
}  // namespace cocalib
