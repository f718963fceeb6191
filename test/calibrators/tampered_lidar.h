#pragma once

#include <algorithm>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib::test {

/// A simulated recording of IMU and lidar that a test may tamper with before a calibrator sees it.
class TamperedLidar {
 public:
  explicit TamperedLidar(double duration_s)
      : scenario_(withDuration(duration_s)), scene_(scenario_), trajectory_(scenario_) {
    imu_ = sim::simulateImu(scenario_, trajectory_);
  }

  ImuNoise noise() const { return {scenario_.imu.gyro_noise_density, 1e-6, scenario_.imu.accel_noise_density, 1e-5}; }
  std::vector<ImuSample>& imu() { return imu_; }
  const std::vector<ImuSample>& imu() const { return imu_; }
  double secondsOf(TimeNs stamp) const { return toSeconds(stamp - scenario_.epoch); }
  int sweeps() const { return sim::scanCount(scenario_); }
  LidarScan sweep(int k) const { return sim::simulateScan(scenario_, scene_, trajectory_, k).scan; }
  double error_m(const CalibrationEstimate& estimate) const {
    return (estimate.calibration.T_imu_lidar.t - scenario_.lidar.T_imu_lidar().t).norm();
  }

  /// Takes the samples of [from, to) seconds away.
  void loseImu(double from, double to) {
    const auto lost = [&](const ImuSample& s) { return secondsOf(s.stamp) >= from && secondsOf(s.stamp) < to; };
    imu_.erase(std::remove_if(imu_.begin(), imu_.end(), lost), imu_.end());
  }
  /// An IMU that has gone mad: rates and forces of [from, to) seconds are rolled by dice.
  void breakImu(double from, double to) {
    std::mt19937 random(1);
    std::normal_distribution<double> rate(0.0, 20.0), force(0.0, 50.0);
    for (ImuSample& sample : imu_) {
      if (secondsOf(sample.stamp) < from || secondsOf(sample.stamp) >= to) continue;
      for (int i = 0; i < 3; ++i) {
        sample.gyro[i] += rate(random);
        sample.accel[i] += force(random);
      }
    }
  }

 private:
  static sim::Scenario withDuration(double duration_s) {
    sim::Scenario s;
    s.duration_s = duration_s;
    return s;
  }

  sim::Scenario scenario_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
  std::vector<ImuSample> imu_;
};

inline std::uint64_t countOf(const CalibratorDiagnostics& diagnostics, const std::string& what) {
  const auto found = diagnostics.counts.find(what);
  return found == diagnostics.counts.end() ? 0 : found->second;
}

}  // namespace cocalib::test
