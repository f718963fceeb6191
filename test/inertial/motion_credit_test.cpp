#include "cocalib/inertial/motion_credit.h"

#include <gtest/gtest.h>

#include <cmath>

#include "cocalib/sim/imu.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

constexpr double kTwoPi = 6.283185307179586;
constexpr TimeNs kBegin = 1'000'000'000;

/// Credits 4 s that are measured without noise as `rate(t)` and `force(t)`, in segments of 50 ms.
template <typename Rate, typename Force>
MotionCredit creditOf(Rate rate, Force force) {
  ImuBuffer imu;
  for (int i = 0; i <= 2010; ++i) {
    const double t = (i - 5) / 500.0;
    imu.push({kBegin + toNs(t), rate(t), force(t)});
  }
  MotionCredit credit{ImuNoise()};
  NavState state;
  state.stamp = kBegin;
  for (int k = 0; k < 80; ++k) {
    const Preintegration segment(imu.slice(state.stamp, state.stamp + toNs(0.05)), ImuNoise(), state.gyro_bias,
                                 state.accel_bias);
    credit.add(state, segment);
    state = propagate(segment, state, 0.0, segment.end());
  }
  return credit;
}

const auto kNone = [](double) -> Eigen::Vector3d { return Eigen::Vector3d::Zero(); };

TEST(MotionCredit, AFullTurnTakesItsPlaneAllTheWayAround) {
  const auto credit = creditOf([](double) -> Eigen::Vector3d { return {0.0, 0.0, kTwoPi / 2.0}; }, kNone);
  // Over a whole turn the mean of R u is nothing: 1 rad^2 for 4 s.
  EXPECT_NEAR(credit.turning()(0, 0), 4.0, 0.02);
  EXPECT_NEAR(credit.turning()(1, 1), 4.0, 0.02);
  EXPECT_LT(std::abs(credit.turning()(2, 2)), 1e-9);
}

TEST(MotionCredit, ASwingCountsByItsMeanSquare) {
  constexpr double kAmplitude = 0.05, kPulsation = 2.0 * kTwoPi;
  const auto credit = creditOf(kNone, [](double t) -> Eigen::Vector3d {
    return {-kAmplitude * kPulsation * kPulsation * std::cos(kPulsation * t), 0.0, 0.0};
  });
  const double expected = 4.0 * 0.5 * kAmplitude * kAmplitude;
  EXPECT_NEAR(credit.shifting(), expected, 0.05 * expected);
}

TEST(MotionCredit, NeitherSpeedNorBiasNorTiltIsAShift) {
  const auto credit = creditOf(kNone, [](double) -> Eigen::Vector3d { return {0.3, -0.2, 9.81}; });
  EXPECT_EQ(credit.shifting(), 0.0);
  EXPECT_LT(credit.turning().norm(), 1e-12);
}

bool shiftShowsIn(sim::Motion motion) {
  sim::Scenario scenario;
  scenario.motion = motion;
  scenario.duration_s = 8.0;
  const sim::Trajectory trajectory(scenario);
  ImuBuffer imu;
  for (const ImuSample& sample : sim::simulateImu(scenario, trajectory)) imu.push(sample);
  return shiftShows(imu, trajectory.stampOf(1.0), trajectory.stampOf(6.0), Eigen::Vector3d::Zero());
}

TEST(ShiftShows, UnlessTheRigOnlyTurnsOrStandsStill) {
  EXPECT_TRUE(shiftShowsIn(sim::Motion::kFull));
  EXPECT_TRUE(shiftShowsIn(sim::Motion::kMild));
  EXPECT_TRUE(shiftShowsIn(sim::Motion::kPlanar));
  EXPECT_TRUE(shiftShowsIn(sim::Motion::kTranslationOnly));
  EXPECT_FALSE(shiftShowsIn(sim::Motion::kRotationOnly));
  EXPECT_FALSE(shiftShowsIn(sim::Motion::kStatic));
}

TEST(ShiftShows, NotWhereTheImuCoversNothing) {
  EXPECT_FALSE(shiftShows(ImuBuffer(), 0, kBegin, Eigen::Vector3d::Zero()));
}

}  // namespace
}  // namespace cocalib
