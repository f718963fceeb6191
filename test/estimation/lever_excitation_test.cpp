#include "cocalib/estimation/lever_excitation.h"

#include <gtest/gtest.h>

#include "cocalib/sim/imu.h"
#include "cocalib/sim/random.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

/// 5 s of states, as well as a window knows them, with the inertial segments between them.
struct Stretch {
  explicit Stretch(sim::Motion motion, double from_s = 3.0) {
    sim::Scenario scenario;
    scenario.motion = motion;
    scenario.duration_s = from_s + 6.0;
    const sim::Trajectory trajectory(scenario);
    sim::Random random(1, sim::Random::Stream::kTexture, 0);
    for (double t = from_s; t < from_s + 5.0; t += 0.05) {
      NavState state = trajectory.stateAt(trajectory.stampOf(t));
      state.T_W_I.q = expSo3(2e-4 / std::sqrt(3.0) * random.normal3()) * state.T_W_I.q;
      state.T_W_I.t += jitter_m * random.normal3();
      states.push_back(state);
    }
    ImuBuffer imu;
    for (const ImuSample& sample : sim::simulateImu(scenario, trajectory)) imu.push(sample);
    chain.update(states, imu);
  }
  static constexpr double jitter_m = 1e-2;  // of a camera's window whose scale is open

  std::vector<NavState> states;
  InertialChain chain{ImuNoise{1.7e-4, 1e-6, 6e-4, 1e-5}};
};

UnseenLevers unseen(const LeverExcitation& before, sim::Motion motion) {
  const Stretch stretch(motion);
  return before.unseen(stretch.states, stretch.chain);
}

TEST(LeverExcitation, NamesWhatTheRigHasNotTurned) {
  const LeverExcitation nothing_yet;
  EXPECT_EQ(unseen(nothing_yet, sim::Motion::kFull).directions.cols(), 0);
  EXPECT_EQ(unseen(nothing_yet, sim::Motion::kMild).directions.cols(), 0);
  EXPECT_EQ(unseen(nothing_yet, sim::Motion::kRotationOnly).directions.cols(), 0);
  EXPECT_EQ(unseen(nothing_yet, sim::Motion::kTranslationOnly).directions.cols(), 3);
  for (const sim::Motion motion : {sim::Motion::kPlanar, sim::Motion::kUpright}) {
    const Eigen::Matrix3Xd open = unseen(nothing_yet, motion).directions;
    ASSERT_EQ(open.cols(), 1);
    EXPECT_GT(std::abs(open(2, 0)), 0.999);
  }
}

TEST(LeverExcitation, SeesTheScaleOnceTheRigIsShifted) {
  const LeverExcitation nothing_yet;
  EXPECT_TRUE(unseen(nothing_yet, sim::Motion::kRotationOnly).scale);
  EXPECT_FALSE(unseen(nothing_yet, sim::Motion::kPlanar).scale);
  EXPECT_FALSE(unseen(nothing_yet, sim::Motion::kFull).scale);
  // However long the rig only turns, the jitter of its estimated positions is no shift.
  LeverExcitation excitation;
  const Stretch turning(sim::Motion::kRotationOnly);
  for (int i = 0; i < 100; ++i) excitation.remember(turning.states, turning.chain, 20);
  EXPECT_TRUE(unseen(excitation, sim::Motion::kRotationOnly).scale);
}

TEST(LeverExcitation, RemembersWhatHasLeftTheWindow) {
  LeverExcitation excitation;
  const Stretch planar(sim::Motion::kPlanar), mild(sim::Motion::kMild);
  for (int i = 0; i < 100; ++i) excitation.remember(planar.states, planar.chain, 20);
  EXPECT_EQ(unseen(excitation, sim::Motion::kPlanar).directions.cols(), 1);
  excitation.remember(mild.states, mild.chain, 20);
  EXPECT_EQ(unseen(excitation, sim::Motion::kPlanar).directions.cols(), 0);
}

/// A system whose every block is filled, over two nodes and two planes.
ChainSystem filledSystem(const WindowState& state) {
  sim::Random random(2, sim::Random::Stream::kTexture, 0);
  const int globals = GlobalLayout::size(static_cast<int>(state.planes.size()));
  ChainSystem system(2, globals);
  for (int i = 0; i < 15 + globals; ++i) {
    Eigen::VectorXd row(15 + globals);
    for (Eigen::Index j = 0; j < row.size(); ++j) row[j] = random.normal();
    const Eigen::VectorXd node = row.head(15), global = row.tail(globals);
    system.diagonal(0) += node * node.transpose();
    system.diagonal(1) += node * node.transpose();
    system.coupling(0) += node * global.transpose();
    system.coupling(1) -= node * global.transpose();
    system.H_global += global * global.transpose();
    system.gradient(0) += node;
    system.b_global += global;
  }
  return system;
}

TEST(LeverExcitation, ABlindSystemKnowsNothingAlongTheShift) {
  WindowState state;
  state.nodes = Stretch(sim::Motion::kPlanar).states;
  state.planes = {{Eigen::Vector3d::UnitZ(), 0.1}, {Eigen::Vector3d(1.0, 0.0, 1.0).normalized(), 0.5}};
  ChainSystem system = filledSystem(state);
  const UnseenLevers up = {Eigen::Vector3d::UnitZ(), false};
  blind(up, {true, true, true, true}, state, &system);
  Eigen::VectorXd shift = Eigen::VectorXd::Zero(system.globals());
  shift[GlobalLayout::kCamera + 2] = shift[GlobalLayout::kLidar + 2] = shift[GlobalLayout::kBoard + 2] = 1.0;
  for (int i = 0; i < 2; ++i) {
    shift[GlobalLayout::plane(i) + 2] = state.planes[static_cast<std::size_t>(i)].normal.z();
  }
  EXPECT_LT((system.H_global * shift).norm(), 1e-3 * system.H_global.norm() * shift.norm());
  EXPECT_LT(std::abs(system.b_global.dot(shift)), 1e-3 * system.b_global.norm());
  for (int i = 0; i < 2; ++i) EXPECT_LT((system.coupling(i) * shift).norm(), 1e-3 * system.coupling(i).norm());
  // What the two sensors' lever arms differ by is known as before.
  Eigen::VectorXd apart = Eigen::VectorXd::Zero(system.globals());
  apart[GlobalLayout::kCamera + 2] = 1.0;
  apart[GlobalLayout::kLidar + 2] = -1.0;
  const ChainSystem before = filledSystem(state);
  EXPECT_NEAR(apart.dot(system.H_global * apart), apart.dot(before.H_global * apart), 1e-6);
}

}  // namespace
}  // namespace cocalib
