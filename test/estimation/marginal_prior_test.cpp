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

}  // namespace
}  // namespace cocalib
