#include "cocalib/estimation/marginal_prior.h"

#include <gtest/gtest.h>

#include <random>

namespace cocalib {
namespace {

constexpr int kPlanes = 3;

/// A prior over one node and all globals, dense and well conditioned.
struct Fixture {
  Fixture() {
    state.nodes.resize(2);
    state.planes.resize(kPlanes);
    for (int i = 0; i < kPlanes; ++i) {
      state.planes[static_cast<std::size_t>(i)].normal = Eigen::Vector3d::Unit(i);
      state.planes[static_cast<std::size_t>(i)].offset_m = 1.0 + i;
      state.planes[static_cast<std::size_t>(i)].anchor << 0.5 * i, 2.0 - i, 1.0;
    }
    marginal.kept = {3};  // of which three are dropped: node 0 now
    const Eigen::Index size = 15 + GlobalLayout::size(kPlanes);
    std::mt19937_64 random(5);
    std::normal_distribution<double> normal;
    const Eigen::MatrixXd A = Eigen::MatrixXd::NullaryExpr(size, size, [&] { return normal(random); });
    marginal.H = A * A.transpose() + Eigen::MatrixXd::Identity(size, size);
    marginal.b = Eigen::VectorXd::NullaryExpr(size, [&] { return normal(random); });
  }

  /// Information and gradient of the globals once the nodes are eliminated; the second node is held by a unit prior.
  std::pair<Eigen::MatrixXd, Eigen::VectorXd> globals(const MarginalPrior& prior, const WindowState& at) const {
    ChainSystem system(2, GlobalLayout::size(kPlanes));
    prior.accumulate(at, &system);
    system.diagonal(1).setIdentity();
    std::pair<Eigen::MatrixXd, Eigen::VectorXd> out;
    EXPECT_TRUE(system.globalInformation(&out.first, &out.second));
    return out;
  }

  WindowState state;
  ChainSystem::Marginal marginal;
};

TEST(MarginalPrior, ForgettingAPlaneKeepsWhatItSaidOfTheRest) {
  const Fixture f;
  MarginalPrior prior(f.marginal, 3, f.state);
  const auto [H, b] = f.globals(prior, f.state);
  prior.forgetPlane(1);
  const auto [H_left, b_left] = f.globals(prior, f.state);

  const Eigen::Index at = GlobalLayout::plane(1), size = H.rows(), after = size - at - 3;
  // Eliminating the plane from the full information, one block at a time, must give the same.
  const Eigen::Matrix3d P = H.block<3, 3>(at, at).inverse();
  const Eigen::MatrixXd H_want = H - H.middleCols(at, 3) * P * H.middleRows(at, 3);
  const Eigen::VectorXd b_want = b - H.middleCols(at, 3) * P * b.segment(at, 3);
  const double scale = H.cwiseAbs().maxCoeff();
  EXPECT_LT((H_left.topLeftCorner(at, at) - H_want.topLeftCorner(at, at)).cwiseAbs().maxCoeff(), 1e-9 * scale);
  EXPECT_LT((H_left.bottomRightCorner(after, after) - H_want.bottomRightCorner(after, after)).cwiseAbs().maxCoeff(),
            1e-9 * scale);
  EXPECT_LT((b_left.head(at) - b_want.head(at)).cwiseAbs().maxCoeff(), 1e-9 * scale);
  EXPECT_LT((b_left.tail(after) - b_want.tail(after)).cwiseAbs().maxCoeff(), 1e-9 * scale);
  EXPECT_EQ(H_left.middleCols(at, 3).cwiseAbs().maxCoeff(), 0.0);
  EXPECT_EQ(b_left.segment(at, 3).cwiseAbs().maxCoeff(), 0.0);
}

TEST(MarginalPrior, ANewPlaneUnderAFreeNumberIsNotPulled) {
  const Fixture f;
  MarginalPrior prior(f.marginal, 3, f.state);
  prior.forgetPlane(0);
  const auto before = f.globals(prior, f.state);
  WindowState moved = f.state;
  moved.planes[0] = {Eigen::Vector3d(0.0, -0.6, 0.8), 17.0};
  prior.startPlane(0, moved.planes[0]);
  const auto after = f.globals(prior, moved);
  EXPECT_EQ(before.first, after.first);
  EXPECT_EQ(before.second, after.second);
}

TEST(MarginalPrior, PlanesThatItNeverKnewAreLeftAlone) {
  const Fixture f;
  MarginalPrior prior(f.marginal, 3, f.state);
  const auto before = f.globals(prior, f.state);
  prior.forgetPlane(kPlanes);
  prior.startPlane(kPlanes, Plane());
  EXPECT_EQ(before.first, f.globals(prior, f.state).first);
}

/// Cost of the prior at a state.
double costAt(const MarginalPrior& prior, const WindowState& state) {
  ChainSystem system(static_cast<int>(state.nodes.size()), GlobalLayout::size(kPlanes));
  prior.accumulate(state, &system);
  return system.cost;
}

/// A step of the given sizes along nodes and globals.
ChainSystem::Step randomStep(double size, unsigned seed) {
  std::mt19937_64 random(seed);
  std::normal_distribution<double> normal(0.0, size);
  ChainSystem::Step step;
  step.nodes.assign(2, Vector15d::NullaryExpr([&] { return normal(random); }));
  step.globals = Eigen::VectorXd::NullaryExpr(GlobalLayout::size(kPlanes), [&] { return normal(random); });
  return step;
}

/// Everything that has a place in the world, moved by A.
WindowState movedBy(const Pose& A, WindowState state) {
  for (NavState& node : state.nodes) {
    node.T_W_I = A * node.T_W_I;
    node.v_W = A.q * node.v_W;
  }
  state.T_W_B = A * state.T_W_B;
  for (Plane& plane : state.planes) {
    plane.normal = A.q * plane.normal;
    plane.offset_m += plane.normal.dot(A.t);
  }
  return state;
}

TEST(MarginalPrior, GradientIsThatOfItsCost) {
  Fixture f;
  // A floor whose normal has two components near zero: which one is smaller depends on the noise, and with it the basis
  // of the plane's tangent.
  f.state.planes[2].normal = Eigen::Vector3d(1e-4, -2e-4, 1.0).normalized();
  f.state.nodes[0].T_W_I.t << 1.0, -2.0, 0.5;
  f.state.nodes[0].v_W << 0.4, 0.3, -0.2;
  f.state.T_W_B.t << 3.0, 0.5, -1.0;
  const MarginalPrior prior(f.marginal, 3, f.state);
  WindowState at = movedBy({expSo3({0.02, -0.03, 0.3}), {0.1, 0.2, -0.3}}, f.state).plus(randomStep(1e-4, 7));
  const Plane floor = at.planes[2];
  ASSERT_GT((planeBasis(floor.normal) - planeBasis(f.state.planes[2].normal)).norm(), 0.1);

  ChainSystem system(2, GlobalLayout::size(kPlanes));
  prior.accumulate(at, &system);
  const double h = 1e-6;
  for (int i = 0; i < 15 + GlobalLayout::size(kPlanes); ++i) {
    ChainSystem::Step forth = randomStep(0.0, 1);
    (i < 15 ? forth.nodes[0][i] : forth.globals[i - 15]) = h;
    ChainSystem::Step back = forth;
    (i < 15 ? back.nodes[0][i] : back.globals[i - 15]) = -h;
    const double numeric = (costAt(prior, at.plus(forth)) - costAt(prior, at.plus(back))) / (2.0 * h);
    const double analytic = i < 15 ? system.gradient(0)[i] : system.b_global[i - 15];
    EXPECT_NEAR(numeric, analytic, 1e-3 * (1.0 + std::abs(numeric))) << "row " << i;
  }
}

TEST(MarginalPrior, ACommonMotionOfTheWorldIsNoContradiction) {
  Fixture f;
  f.state.nodes[0].T_W_I.t << 1.0, -2.0, 0.5;
  f.state.nodes[0].v_W << 0.4, 0.3, -0.2;
  f.state.T_W_B.t << 3.0, 0.5, -1.0;
  // What small common motions change, about the state: none of it is known.
  const Eigen::Index size = f.marginal.H.rows();
  Eigen::MatrixXd N(size, 6);
  const double h = 1e-6;
  for (int k = 0; k < 6; ++k) {
    Vector6d xi = Vector6d::Zero();
    xi[k] = h;
    const WindowState moved = movedBy({expSo3(xi.tail<3>()), xi.head<3>()}, f.state);
    N.col(k) << minus(moved.nodes[0], f.state.nodes[0]) / h, globalMinus(moved, f.state) / h;
  }
  const Eigen::MatrixXd P = Eigen::MatrixXd::Identity(size, size) - N * (N.transpose() * N).ldlt().solve(N.transpose());
  f.marginal.H = (P * f.marginal.H * P).eval();
  f.marginal.b = (P * f.marginal.b).eval();
  const MarginalPrior prior(f.marginal, 3, f.state);
  const WindowState near = f.state.plus(randomStep(1e-3, 3));
  const WindowState far = movedBy({expSo3({0.1, -0.2, 0.5}), {0.4, 0.2, -0.3}}, near);
  EXPECT_NEAR(costAt(prior, near), costAt(prior, far), 1e-5 * (1.0 + std::abs(costAt(prior, near))));
}

}  // namespace
}  // namespace cocalib
