#include "cocalib/sim/trajectory.h"

#include <gtest/gtest.h>

#include "cocalib/sim/scene.h"

namespace cocalib::sim {
namespace {

// Central differences over 1e-4 s: truncation under 1e-6 with rates up to 7 rad/s, rounding under 1e-7 for the second
// one.
TEST(Trajectory, DerivativesMatchDifferencesAlsoWhileTheMotionSwellsAndFades) {
  for (const std::uint64_t seed : {1U, 7U}) {
    Scenario scenario;
    scenario.seed = seed;
    scenario.planar_for_s = 9.0;
    scenario.parked_after_s = 10.0;
    const Trajectory trajectory(scenario);
    constexpr double h = 1e-4;
    for (const double t : {-0.05, 0.2, 0.75, 1.4, 1.6, 9.3, 10.2, 10.9, 55.0}) {
      const Trajectory::Kinematics k = trajectory.at(t);
      const Pose before = trajectory.T_W_I(t - h), after = trajectory.T_W_I(t + h);
      EXPECT_LT(((after.t - before.t) / (2 * h) - k.v_W).norm(), 1e-5) << t;
      EXPECT_LT(((trajectory.velocity(t + h) - trajectory.velocity(t - h)) / (2 * h) - k.a_W).norm(), 1e-5) << t;
      const Eigen::Vector3d omega = logSo3(before.q.conjugate() * after.q) / (2 * h);
      EXPECT_LT((omega - k.omega_I).norm(), 1e-5) << t;
      EXPECT_LT((trajectory.T_W_I(t).t - k.T_W_I.t).norm(), 1e-12);
    }
  }
}

TEST(Trajectory, DerivativesMatchDifferencesOnTheDrive) {
  Scenario scenario;
  scenario.place = Place::kBuilding;
  const Trajectory trajectory(scenario);
  constexpr double h = 1e-4;
  for (const double t : {0.2, 0.75, 1.4, 1.6, 9.3, 55.0}) {
    const Trajectory::Kinematics k = trajectory.at(t);
    const Pose before = trajectory.T_W_I(t - h), after = trajectory.T_W_I(t + h);
    EXPECT_LT(((after.t - before.t) / (2 * h) - k.v_W).norm(), 1e-5) << t;
    EXPECT_LT(((trajectory.velocity(t + h) - trajectory.velocity(t - h)) / (2 * h) - k.a_W).norm(), 1e-5) << t;
    EXPECT_LT((logSo3(before.q.conjugate() * after.q) / (2 * h) - k.omega_I).norm(), 1e-5) << t;
  }
}

TEST(Trajectory, TheDriveGoesThroughTheDoorsAndComesBack) {
  for (const std::uint64_t seed : {1U, 5U}) {
    Scenario scenario;
    scenario.seed = seed;
    scenario.place = Place::kBuilding;
    const Trajectory trajectory(scenario);
    const Scene scene(scenario);
    // A step of the way never crosses a wall, and nothing is nearer than 0.4 m.
    Eigen::Vector3d last = trajectory.T_W_I(0.0).t;
    double farthest = 0.0;
    for (double t = 0.05; t < 60.0; t += 0.05) {
      const Eigen::Vector3d here = trajectory.T_W_I(t).t;
      EXPECT_TRUE(scene.visible(last, here)) << t;
      for (int axis = 0; axis < 2; ++axis) {
        for (const double side : {-1.0, 1.0}) {
          const auto hit = scene.raycast(here, side * Eigen::Vector3d::Unit(axis));
          ASSERT_TRUE(hit) << t;
          EXPECT_GT(hit->range, 0.4) << t;
        }
      }
      farthest = std::max(farthest, (here - restPosition()).norm());
      last = here;
    }
    EXPECT_GT(farthest, 18.0);
    EXPECT_LT((trajectory.T_W_I(55.4).t - restPosition()).norm(), 2.5);  // once around, and the swaying
  }
}

TEST(Trajectory, MotionsMoveOnlyTheirAxes) {
  Scenario scenario;
  scenario.motion = Motion::kPlanar;
  const Trajectory planar(scenario);
  scenario.motion = Motion::kRotationOnly;
  const Trajectory rotation(scenario);
  scenario.motion = Motion::kTranslationOnly;
  const Trajectory translation(scenario);
  scenario.motion = Motion::kStatic;
  const Trajectory still(scenario);
  for (double t = 0.0; t < 20.0; t += 0.37) {
    EXPECT_EQ(planar.velocity(t).z(), 0.0);
    EXPECT_EQ(planar.bodyRate(t).head<2>().norm(), 0.0);
    EXPECT_EQ(rotation.velocity(t).norm(), 0.0);
    EXPECT_EQ(translation.bodyRate(t).norm(), 0.0);
    EXPECT_EQ(still.velocity(t).norm() + still.bodyRate(t).norm(), 0.0);
  }
}

TEST(Trajectory, PlanarAtFirstIsFullLater) {
  Scenario scenario;
  const Trajectory full(scenario);
  scenario.planar_for_s = 12.0;
  const Trajectory late(scenario);
  for (double t = 0.0; t <= 12.0; t += 0.37) {
    EXPECT_EQ(late.velocity(t).z(), 0.0);
    EXPECT_EQ(late.bodyRate(t).head<2>().norm(), 0.0);
  }
  for (double t = 12.0 + scenario.ramp_s; t < 20.0; t += 0.37) EXPECT_EQ(late.bodyRate(t), full.bodyRate(t));
}

TEST(Trajectory, AParkedRigStands) {
  Scenario scenario;
  const Trajectory moving(scenario);
  scenario.parked_after_s = 12.0;
  const Trajectory parked(scenario);
  for (double t = 0.0; t <= 12.0; t += 0.37) EXPECT_EQ(parked.bodyRate(t), moving.bodyRate(t));
  for (double t = 12.0 + scenario.ramp_s; t < 20.0; t += 0.37) {
    EXPECT_EQ(parked.velocity(t).norm() + parked.bodyRate(t).norm(), 0.0);
    EXPECT_EQ(parked.T_W_I(t).t, restPosition());
  }
}

TEST(Trajectory, SeedsMoveDifferently) {
  Scenario scenario;
  const Trajectory first(scenario);
  scenario.seed = 2;
  const Trajectory second(scenario);
  scenario.seed = 3;
  const Trajectory third(scenario);
  EXPECT_GT((first.T_W_I(10.0).t - second.T_W_I(10.0).t).norm(), 0.01);
  EXPECT_GT((second.T_W_I(10.0).t - third.T_W_I(10.0).t).norm(), 0.01);
}

}  // namespace
}  // namespace cocalib::sim
