#include "cocalib/sim/imu.h"

#include <cmath>

#include "cocalib/sim/random.h"

namespace cocalib::sim {
namespace {

// Before the first and after the last picture or sweep, so that interpolation never runs out of samples.
constexpr double kMargin_s = 0.1;

Eigen::Vector3d drawBias(Random& random, double size) {
  Eigen::Vector3d bias;
  for (int i = 0; i < 3; ++i) {
    const double sign = random.uniform() < 0.5 ? -1.0 : 1.0;
    bias[i] = sign * size * random.uniform(0.5, 1.5);
  }
  return bias;
}

}  // namespace

ImuBias trueImuBias(const Scenario& scenario) {
  Random random(scenario.seed, Random::Stream::kBias);
  ImuBias bias;
  bias.gyro = drawBias(random, scenario.imu.gyro_bias);
  bias.accel = drawBias(random, scenario.imu.accel_bias);
  return bias;
}

std::vector<ImuSample> simulateImu(const Scenario& scenario, const Trajectory& trajectory,
                                   std::vector<ImuBias>* biases) {
  const Scenario::Imu& imu = scenario.imu;
  const Eigen::Vector3d g_W(0.0, 0.0, -scenario.gravity);
  const double gyro_sigma = imu.gyro_noise_density * std::sqrt(imu.rate_hz);
  const double accel_sigma = imu.accel_noise_density * std::sqrt(imu.rate_hz);
  const double walk_step = 1.0 / std::sqrt(imu.rate_hz);
  Random random(scenario.seed, Random::Stream::kImu);
  ImuBias bias = trueImuBias(scenario);

  const int before = static_cast<int>(std::lround(kMargin_s * imu.rate_hz));
  const int last = static_cast<int>(std::lround((scenario.duration_s + kMargin_s) * imu.rate_hz));
  std::vector<ImuSample> samples;
  samples.reserve(before + last + 1);
  if (biases != nullptr) biases->clear();
  for (int i = -before; i <= last; ++i) {
    ImuSample sample;
    sample.stamp = trajectory.stampOf(i / imu.rate_hz);
    const Trajectory::Kinematics k = trajectory.at(trajectory.timeOf(sample.stamp));
    sample.gyro = k.omega_I + bias.gyro + gyro_sigma * random.normal3();
    sample.accel = k.T_W_I.q.conjugate() * (k.a_W - g_W) + bias.accel + accel_sigma * random.normal3();
    samples.push_back(sample);
    if (biases != nullptr) biases->push_back(bias);
    bias.gyro += imu.gyro_bias_walk * walk_step * random.normal3();
    bias.accel += imu.accel_bias_walk * walk_step * random.normal3();
  }
  return samples;
}

}  // namespace cocalib::sim
