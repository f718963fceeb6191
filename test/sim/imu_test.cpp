#include "cocalib/sim/imu.h"

#include <gtest/gtest.h>

#include <cmath>

#include "cocalib/geometry/so3.h"

namespace cocalib::sim {
namespace {

Scenario noiseFree(double duration_s) {
  Scenario scenario;
  scenario.duration_s = duration_s;
  scenario.imu.gyro_noise_density = scenario.imu.accel_noise_density = 0.0;
  scenario.imu.gyro_bias = scenario.imu.accel_bias = 0.0;
  return scenario;
}

// Integrates samples with a fourth-order scheme: two intervals at a time, the middle sample being the mid-point.
NavState integrate(const std::vector<ImuSample>& samples, NavState state, double gravity) {
  const Eigen::Vector3d g_W(0.0, 0.0, -gravity);
  std::size_t i = 0;
  while (samples[i].stamp < state.stamp) ++i;
  for (; i + 2 < samples.size(); i += 2) {
    const double h = toSeconds(samples[i + 2].stamp - samples[i].stamp);
    const Eigen::Vector3d &w0 = samples[i].gyro, &w1 = samples[i + 1].gyro, &w2 = samples[i + 2].gyro;
    // Rotation vectors over the half and the whole step (Magnus series, quadratic rate).
    const Eigen::Vector3d half = h / 24.0 * (5.0 * w0 + 8.0 * w1 - w2) + h * h / 48.0 * w0.cross(w1);
    const Eigen::Vector3d whole = h / 6.0 * (w0 + 4.0 * w1 + w2) + h * h / 12.0 * w0.cross(w2);
    const Eigen::Quaterniond q0 = state.T_W_I.q, q1 = q0 * expSo3(half), q2 = (q0 * expSo3(whole)).normalized();
    const Eigen::Vector3d a0 = q0 * samples[i].accel + g_W, a1 = q1 * samples[i + 1].accel + g_W,
                          a2 = q2 * samples[i + 2].accel + g_W;
    state.T_W_I.t += h * state.v_W + h * h / 6.0 * (a0 + 2.0 * a1);
    state.v_W += h / 6.0 * (a0 + 4.0 * a1 + a2);
    state.T_W_I.q = q2;
    state.stamp = samples[i + 2].stamp;
  }
  return state;
}

TEST(SimulatedImu, NoiseFreeSamplesIntegrateBackOntoTheTrajectory) {
  for (const Motion motion : {Motion::kFull, Motion::kMild, Motion::kPlanar, Motion::kStatic}) {
    Scenario scenario = noiseFree(10.0);
    scenario.motion = motion;
    const Trajectory trajectory(scenario);
    const NavState end =
        integrate(simulateImu(scenario, trajectory), trajectory.stateAt(scenario.epoch), scenario.gravity);
    const NavState truth = trajectory.stateAt(end.stamp);
    EXPECT_GT(toSeconds(end.stamp - scenario.epoch), 9.99);
    EXPECT_LT((end.T_W_I.t - truth.T_W_I.t).norm(), 1e-4);
    EXPECT_LT((end.v_W - truth.v_W).norm(), 1e-4);
    EXPECT_LT(logSo3(end.T_W_I.q * truth.T_W_I.q.conjugate()).norm(), 1e-5);
  }
}

TEST(SimulatedImu, StartsAtRest) {
  const Scenario scenario = noiseFree(2.0);
  const std::vector<ImuSample> samples = simulateImu(scenario, Trajectory(scenario));
  EXPECT_LT(samples.front().stamp, scenario.epoch);
  EXPECT_LT(samples.front().gyro.norm(), 1e-12);
  EXPECT_NEAR((samples.front().accel - Eigen::Vector3d(0, 0, scenario.gravity)).norm(), 0.0, 1e-12);
}

TEST(SimulatedImu, NoiseAndBiasHaveTheStatedSize) {
  Scenario scenario;
  scenario.motion = Motion::kStatic;
  const std::vector<ImuSample> samples = simulateImu(scenario, Trajectory(scenario));
  Eigen::Array3d sum = Eigen::Array3d::Zero(), squares = Eigen::Array3d::Zero();
  for (const ImuSample& sample : samples) sum += sample.gyro.array();
  const Eigen::Array3d mean = sum / samples.size();
  for (const ImuSample& sample : samples) squares += (sample.gyro.array() - mean).square();
  const double sigma = scenario.imu.gyro_noise_density * std::sqrt(scenario.imu.rate_hz);
  const Eigen::Vector3d bias = trueImuBias(scenario).gyro;
  // The mean of 24,000 samples scatters by sigma / 155, their deviation by sigma / 220: five times that is allowed.
  EXPECT_LT((mean - bias.array()).abs().maxCoeff(), 5.0 * sigma / 155.0);
  EXPECT_LT(((squares / samples.size()).sqrt() - sigma).abs().maxCoeff(), 5.0 * sigma / 220.0);
  EXPECT_GE(bias.cwiseAbs().minCoeff(), 0.5 * scenario.imu.gyro_bias);
  EXPECT_LE(bias.cwiseAbs().maxCoeff(), 1.5 * scenario.imu.gyro_bias);
}

TEST(SimulatedImu, SeedDecidesEverything) {
  Scenario scenario;
  scenario.duration_s = 1.0;
  const std::vector<ImuSample> a = simulateImu(scenario, Trajectory(scenario));
  const std::vector<ImuSample> b = simulateImu(scenario, Trajectory(scenario));
  scenario.seed = 2;
  const std::vector<ImuSample> other = simulateImu(scenario, Trajectory(scenario));
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_EQ(a[i].gyro, b[i].gyro);
    EXPECT_EQ(a[i].accel, b[i].accel);
    EXPECT_NE(a[i].gyro, other[i].gyro);
  }
}

}  // namespace
}  // namespace cocalib::sim
