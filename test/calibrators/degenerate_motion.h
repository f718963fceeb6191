#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>
#include <vector>

#include "cocalib/estimation/estimate.h"
#include "cocalib/sensors/imu_noise.h"
#include "cocalib/sim/scenario.h"

namespace cocalib::test {

inline sim::Scenario scenarioOf(sim::Motion motion, std::uint64_t seed, double duration_s) {
  sim::Scenario s;
  s.motion = motion;
  s.seed = seed;
  s.duration_s = duration_s;
  s.camera.time_offset_s = -0.015;
  s.lidar.time_offset_s = 0.02;
  return s;
}

inline ImuNoise noiseOf(const sim::Scenario& s) {
  return {s.imu.gyro_noise_density, 1e-6, s.imu.accel_noise_density, 1e-5};
}

/// The axes in `open` (0-2 translation, 3-5 rotation) are flagged, and no others. What is flagged is within a sigma
/// that is as before any data, what is not within 4 sigma and `small` (m for translation; rad for rotation, a third of
/// it).
inline void expectOnlyOpen(const SensorVerdict& verdict, const Vector6d& error, const std::vector<int>& open,
                           double small) {
  ASSERT_TRUE(verdict.valid);
  EXPECT_EQ(verdict.unobservable.size(), open.size());
  for (int i = 0; i < 6; ++i) {
    if (std::count(open.begin(), open.end(), i) > 0) {
      const std::string name = std::string(i < 3 ? "translation along imu " : "rotation about imu ") + "xyz"[i % 3];
      const auto& flags = verdict.unobservable;
      EXPECT_TRUE(std::any_of(flags.begin(), flags.end(), [&](auto& flag) { return flag.rfind(name, 0) == 0; }))
          << name;
      EXPECT_LT(std::abs(error[i]), verdict.sigma[i]) << i;
      EXPECT_GT(verdict.sigma[i], 0.5) << i;
    } else {
      EXPECT_LT(std::abs(error[i]), i < 3 ? small : small / 3.0) << i;
      EXPECT_LT(std::abs(error[i]), 4.0 * verdict.sigma[i]) << i;
    }
  }
}

}  // namespace cocalib::test
