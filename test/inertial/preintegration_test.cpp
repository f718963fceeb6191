#include "cocalib/inertial/preintegration.h"

#include <gtest/gtest.h>

#include <stdexcept>

#include "cocalib/factors/imu_factor.h"
#include "cocalib/inertial/imu_buffer.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/trajectory.h"
#include "numeric_jacobian.h"

namespace cocalib {
namespace {

std::vector<ImuSample> wavySamples(int count) {
  std::vector<ImuSample> samples;
  for (int i = 0; i < count; ++i) {
    const double t = i * 0.0025;
    samples.push_back({toNs(t), {1.0 + t, -0.5 * t, 0.8 - 2.0 * t}, {0.3, 9.5 + 3.0 * t, 1.0 - 4.0 * t}});
  }
  return samples;
}

NavState someState() {
  NavState state;
  state.T_W_I = {expSo3({0.4, -1.1, 0.7}), {3.0, -2.0, 0.5}};
  state.v_W = {0.5, -1.0, 0.25};
  state.gyro_bias = {0.01, -0.02, 0.03};
  state.accel_bias = {0.1, 0.05, -0.08};
  return state;
}

TEST(Preintegration, FollowsTheTrueTrajectoryAtEveryTime) {
  sim::Scenario scenario;
  scenario.duration_s = 3.0;
  scenario.imu.gyro_noise_density = scenario.imu.accel_noise_density = 0.0;
  scenario.imu.gyro_bias = scenario.imu.accel_bias = 0.0;
  const sim::Trajectory trajectory(scenario);
  ImuBuffer imu;
  for (const ImuSample& sample : sim::simulateImu(scenario, trajectory)) imu.push(sample);

  const TimeNs start = trajectory.stampOf(2.0);
  const Preintegration segment(imu.sliceForIntegration(start, trajectory.stampOf(2.1)), ImuNoise(),
                               Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  // Raw rates would be off by h^2 / 12 of their second derivative, here up to 50 rad/s^3: 3e-6 rad in 0.1 s. What is
  // left is the same of the change within the piece of a step that lies between samples, under h^3 / 100 of 50 rad/s^3.
  for (double t = 2.0; t < 2.1; t += 0.0007) {  // off the samples too
    const TimedPose pose = timedPose(segment, trajectory.stateAt(start), scenario.gravity, trajectory.stampOf(t));
    EXPECT_LT((pose.T_W_I.t - trajectory.T_W_I(t).t).norm(), 1e-6);
    EXPECT_LT(pose.T_W_I.q.angularDistance(trajectory.T_W_I(t).q), 1e-7);
    EXPECT_LT((pose.v_W - trajectory.velocity(t)).norm(), 1e-5);
  }
}

TEST(Preintegration, PoseJacobiansMatchCentralDifferences) {
  const Preintegration segment(wavySamples(41), ImuNoise(), Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  const NavState start = someState();
  const TimeNs stamp = toNs(0.0611);
  const Pose at = timedPose(segment, start, 9.8, stamp).T_W_I;
  const auto over_state = [&](const NavState& s) { return timedPose(segment, s, 9.8, stamp).T_W_I.minus(at); };
  const auto numeric = test::numericJacobian<6, 15>(
      start, [](const NavState& s, const Vector15d& d) { return plus(s, d); }, over_state);
  const TimedPose pose = timedPose(segment, start, 9.8, stamp);
  EXPECT_TRUE(pose.J_state.isApprox(numeric, 1e-6)) << pose.J_state - numeric;

  const double h = 1e-4;
  const Vector6d over_gravity = (timedPose(segment, start, 9.8 + h, stamp).T_W_I.minus(at) -
                                 timedPose(segment, start, 9.8 - h, stamp).T_W_I.minus(at)) /
                                (2.0 * h);
  EXPECT_LT((pose.J_gravity - over_gravity).norm(), 1e-8);
  const TimeNs dt = 100000;
  const Vector6d over_time = (timedPose(segment, start, 9.8, stamp + dt).T_W_I.minus(at) -
                              timedPose(segment, start, 9.8, stamp - dt).T_W_I.minus(at)) /
                             (2.0 * toSeconds(dt));
  EXPECT_LT((pose.J_time - over_time).norm(), 1e-3);  // rates change within the difference
}

TEST(Preintegration, ExtrapolatesAFewMilliseconds) {
  const Preintegration segment(wavySamples(41), ImuNoise(), Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  const NavState start = someState();
  const Pose before = timedPose(segment, start, 9.8, toNs(-0.003)).T_W_I;
  const Vector6d expected = -0.003 * timedPose(segment, start, 9.8, 0).J_time;
  EXPECT_LT((before.minus(start.T_W_I) - expected).norm(), 2e-4);
}

TEST(Preintegration, CovarianceGrowsAsNoiseIntegrates) {
  ImuNoise noise;
  std::vector<ImuSample> still(401);
  for (int i = 0; i < 401; ++i) still[static_cast<std::size_t>(i)].stamp = toNs(i * 0.0025);
  const Preintegration segment(still, noise, Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero());
  // White noise of density s over 1 s: variance s^2 in angle and velocity, s^2 / 3 in position.
  const double accel2 = noise.accel_noise_density * noise.accel_noise_density;
  EXPECT_NEAR(segment.covariance()(3, 3), noise.gyro_noise_density * noise.gyro_noise_density, 1e-12);
  EXPECT_NEAR(segment.covariance()(6, 6), accel2, 1e-3 * accel2);
  EXPECT_NEAR(segment.covariance()(0, 0), accel2 / 3.0, 1e-3 * accel2);
}

TEST(Preintegration, RefusesASingleSample) {
  EXPECT_THROW(Preintegration(wavySamples(1), ImuNoise(), Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()),
               std::invalid_argument);
}

}  // namespace
}  // namespace cocalib
