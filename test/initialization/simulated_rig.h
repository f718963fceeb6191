#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "cocalib/geometry/so3.h"
#include "cocalib/inertial/imu_buffer.h"
#include "cocalib/initialization/rotation_initializer.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/random.h"
#include "cocalib/sim/scenario.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib::test {

/// One simulated recording: motion, IMU, and a sensor mounted at T_I_S whose clock is `offset_s` behind the IMU's.
struct SimulatedRig {
  SimulatedRig(sim::Motion motion, std::uint64_t seed, double duration_s, Pose T_I_S_true, double offset_true_s,
               double gyro_bias = 4.85e-5, double accel_bias = 1.5e-4)
      : T_I_S(std::move(T_I_S_true)), offset_s(offset_true_s) {
    scenario.motion = motion;
    scenario.seed = seed;
    scenario.duration_s = duration_s + 1.0;
    scenario.imu.gyro_bias = gyro_bias;
    scenario.imu.accel_bias = accel_bias;
    trajectory = std::make_unique<sim::Trajectory>(scenario);
    for (const ImuSample& sample : sim::simulateImu(scenario, *trajectory)) imu.push(sample);
    bias = sim::trueImuBias(scenario);
    start_s = 0.5;
    end_s = 0.5 + duration_s;
  }

  /// Stamps of the sensor, on its own clock.
  std::vector<TimeNs> stamps(double rate_hz) const {
    std::vector<TimeNs> result;
    for (double t = start_s; t < end_s; t += 1.0 / rate_hz) result.push_back(trajectory->stampOf(t - offset_s));
    return result;
  }

  Pose T_W_I(TimeNs sensor_stamp) const { return trajectory->T_W_I(trajectory->timeOf(sensor_stamp) + offset_s); }
  Pose T_W_S(TimeNs sensor_stamp) const { return T_W_I(sensor_stamp) * T_I_S; }

  /// Rotations between neighbouring stamps, each with its own noise per axis between the two sigmas, and a share of
  /// gross outliers: what two views give.
  std::vector<RelativeSensorRotation> rotations(double rate_hz, double min_sigma, double max_sigma,
                                                double outlier_share) const {
    sim::Random random(scenario.seed, sim::Random::Stream::kTracks, 77);
    const std::vector<TimeNs> times = stamps(rate_hz);
    std::vector<RelativeSensorRotation> result;
    for (std::size_t i = 1; i < times.size(); ++i) {
      Eigen::Quaterniond R = T_W_S(times[i - 1]).q.conjugate() * T_W_S(times[i]).q;
      R = R * expSo3(random.uniform(min_sigma, max_sigma) * random.normal3());
      if (random.uniform() < outlier_share) R = R * expSo3(0.3 * random.normal3());
      result.push_back({times[i - 1], times[i], R});
    }
    return result;
  }

  /// Rotations between neighbouring poses of an odometry whose poses have `sigma` per axis: what a map gives.
  std::vector<RelativeSensorRotation> odometryRotations(double rate_hz, double sigma) const {
    sim::Random random(scenario.seed, sim::Random::Stream::kTracks, 78);
    const std::vector<TimeNs> times = stamps(rate_hz);
    std::vector<Eigen::Quaterniond> poses;
    for (const TimeNs stamp : times) poses.push_back(T_W_S(stamp).q * expSo3(sigma * random.normal3()));
    std::vector<RelativeSensorRotation> result;
    for (std::size_t i = 1; i < times.size(); ++i) {
      result.push_back({times[i - 1], times[i], poses[i - 1].conjugate() * poses[i]});
    }
    return result;
  }

  sim::Scenario scenario;
  std::unique_ptr<sim::Trajectory> trajectory;
  ImuBuffer imu;
  sim::ImuBias bias;
  Pose T_I_S;
  double offset_s;
  double start_s, end_s;  ///< of the sensor's data, seconds on the IMU clock
};

/// Angle between two rotations [rad].
inline double angleBetween(const Eigen::Quaterniond& a, const Eigen::Quaterniond& b) {
  return logSo3(a.conjugate() * b).norm();
}

/// Mountings far from any guess: forward-looking, upside-down, sideways, tumbled; levers up to 0.5 m.
inline std::vector<Pose> mountings() {
  const Eigen::Quaterniond optical(0.5, -0.5, 0.5, -0.5);
  return {{optical * expSo3({0.1, -0.2, 0.1}), {0.1, 0.0, 0.0}},
          {expSo3({M_PI, 0.0, 0.0}), {0.3, 0.3, -0.3}},
          {expSo3({0.0, 0.0, M_PI / 2}), {0.0, -0.5, 0.1}},
          {expSo3({1.9, -1.2, 1.4}), {-0.3, 0.2, 0.35}}};
}

}  // namespace cocalib::test
