#pragma once

#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/calibrators/window_health.h"
#include "cocalib/estimation/inertial_window.h"
#include "cocalib/inertial/imu_inbox.h"
#include "cocalib/initialization/open_start.h"
#include "cocalib/lidar/lidar_odometry.h"
#include "cocalib/measurements/stamp_order.h"

namespace cocalib {

/// When the last point of a sweep, which is in order of time, was measured; lidar clock.
inline TimeNs endOf(const LidarScan& scan) {
  return scan.points.empty() ? scan.stamp : scan.stamp + toNs(scan.points.back().offset_s);
}

/// Odometry, start and window; lidar_inertial_calibrator.cpp and lidar_inertial_start.cpp implement it.
struct LidarInertialCalibrator::Impl {
  Impl(const LidarInertialParams& p, const ImuNoise& noise, const std::optional<Pose>& g)
      : params(p), guess(g), odometry(odometryParams(p)), window(windowParams(p, noise)) {}

  static LidarOdometry::Params odometryParams(const LidarInertialParams& p) {
    LidarOdometry::Params out;
    out.range_noise_m = p.range_noise_m;
    return out;
  }
  static InertialWindow::Params windowParams(const LidarInertialParams& p, const ImuNoise& noise) {
    InertialWindow::Params out;
    out.imu_noise = noise;
    out.lidar = LidarGroup::Params();
    out.lidar->range_noise_m = p.range_noise_m;
    out.plane_map.point_sigma_m = p.range_noise_m;
    return out;
  }

  // Until the mounting is found (lidar_inertial_start.cpp).
  void explore(const std::shared_ptr<const LidarScan>& scan);
  void forgetUselessSweeps();
  bool tryToStart();
  SensorMotion ownMotion() const;
  std::optional<Alignment> align(bool open, std::string* reason);
  void declareUnseen(std::string* reason);
  void startWindow(const Alignment& alignment);
  // After it.
  void advance(const std::function<void()>& look = nullptr);
  void solve();
  bool solveWindow();
  void restart(const std::string& reason);
  void publish();
  std::vector<LidarKeyframe> takeKeyframes();

  LidarInertialParams params;
  std::optional<Pose> guess;
  LidarOdometry odometry;
  InertialWindow window;
  ImuInbox inbox;
  bool started = false;
  double effort = 1.0;  // share of the usual number of points
  // Before the start: raw sweeps with their poses in the odometry's frame, newest initialization_s.
  std::deque<std::shared_ptr<const LidarScan>> raw;
  std::deque<LidarOdometry::Result> poses;
  TimeNs last_try = 0;
  // After it: sweeps that wait for inertial data, and those in the window not yet handed on.
  std::deque<std::shared_ptr<const LidarScan>> waiting, unreported;
  /// Of the unreported ones, those of the last solve. Their stamps do not tell: the solve has moved the clock offset.
  std::size_t solved = 0;
  StampOrder order;
  TimeNs last_solve = 0;
  FailedSolves failed;
  std::string why_anew;  ///< said until the mounting is found again
  std::uint32_t version = 0;
  CalibrationEstimate estimate;
  CalibratorDiagnostics diagnostics;
};

}  // namespace cocalib
