#pragma once

#include <memory>
#include <vector>

#include "cocalib/estimation/inertial_window.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/random.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib::test {

/// A window filled with simulated measurements (no pictures are drawn) and started off the truth, as the initialisation
/// would leave it: 2 cm, 10 mrad, 2 ms in the calibration, 1 cm and 3 mrad in every node.
class SimulatedWindow {
 public:
  struct Use {
    bool corners = false, tracks = false, lidar = false;
    double assumed_imu_noise = 1.0;                   // over the simulated one
    Eigen::Vector3d place = Eigen::Vector3d::Zero();  // of the simulated world's origin in the window's [m]
  };
  SimulatedWindow(const sim::Scenario& scenario, const Use& use)
      : scenario_(scenario),
        scene_(scenario),
        trajectory_(scenario),
        random_(scenario.seed, sim::Random::Stream::kTexture, 77),
        place_(use.place),
        window_(params(scenario, use)) {
    for (const ImuSample& sample : sim::simulateImu(scenario_, trajectory_)) window_.imu().push(sample);
    truth_.T_imu_camera = scenario.camera.T_imu_camera();
    truth_.T_imu_lidar = scenario.lidar.T_imu_lidar();
    Calibration start;
    start.T_imu_camera = truth_.T_imu_camera.plus(noise6(0.02, 0.01));
    start.T_imu_lidar = truth_.T_imu_lidar.plus(noise6(0.02, 0.01));
    start.camera_time_offset_s = 0.002;
    start.lidar_time_offset_s = -0.002;
    window_.reset(noisyState(trajectory_.stampOf(0.02)), start, 9.80665);
    for (double t = 0.07; t < scenario.duration_s - 0.02; t += 0.05)
      window_.addNode(noisyState(trajectory_.stampOf(t)));
    if (use.corners || use.tracks) addFrames(use);
    for (int k = 1; use.lidar && k < sim::scanCount(scenario) - 1; ++k) {
      window_.addScan(std::make_shared<LidarScan>(sim::simulateScan(scenario_, scene_, trajectory_, k).scan));
    }
  }

  void solve() {
    for (const double slack : {0.08, 0.01, 0.0}) {
      window_.relink(Relink::kNewPlanes, slack);
      window_.optimize(8);
    }
  }
  /// Estimate minus truth, in the order of the covariance.
  Vector14d error() const {
    const Calibration& c = window_.state().calibration;
    Vector14d e;
    e << c.T_imu_camera.minus(truth_.T_imu_camera), c.T_imu_lidar.minus(truth_.T_imu_lidar), c.camera_time_offset_s,
        c.lidar_time_offset_s;
    return e;
  }
  InertialWindow& window() { return window_; }
  const sim::Trajectory& trajectory() const { return trajectory_; }

 private:
  static InertialWindow::Params params(const sim::Scenario& scenario, const Use& use) {
    InertialWindow::Params out;
    out.imu_noise = {use.assumed_imu_noise * scenario.imu.gyro_noise_density, 1e-6,
                     use.assumed_imu_noise * scenario.imu.accel_noise_density, 1e-5};
    if (use.corners || use.tracks) {
      out.camera.emplace(scenario.camera.cameraModel());
      out.camera->board = scenario.board.geometry();
      out.camera->corner_sigma_px = scenario.camera.corner_noise_px;
      out.camera->track_noise.sigma_px = scenario.camera.track_noise_px;
    }
    if (use.lidar) {
      out.lidar = LidarGroup::Params();
      out.lidar->range_noise_m = scenario.lidar.range_noise_m;
      if (use.corners) out.lidar->board = scenario.board.geometry();
    }
    return out;
  }
  void addFrames(const Use& use) {
    sim::TrackSimulator tracks(scenario_, scene_, trajectory_);
    for (int k = 3; k < sim::imageCount(scenario_) - 3; k += 2) {
      VisualKeyframe frame;
      frame.stamp = sim::imageStamp(scenario_, k);
      if (use.corners) frame.board = sim::simulateBoard(scenario_, scene_, trajectory_, k);
      if (use.tracks && k % 6 == 3) frame.tracks = tracks.observe(k);
      window_.addFrame(frame);
    }
  }
  Vector6d noise6(double translation, double rotation) {
    Vector6d d;
    d << translation * random_.normal3(), rotation * random_.normal3();
    return d;
  }
  NavState noisyState(TimeNs stamp) {
    Vector15d d = Vector15d::Zero();
    d.head<6>() = noise6(0.01, 0.003);
    d.segment<3>(6) = 0.02 * random_.normal3();
    NavState state = plus(trajectory_.stateAt(stamp), d);
    state.T_W_I.t += place_;
    return state;
  }

  sim::Scenario scenario_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
  sim::Random random_;
  Eigen::Vector3d place_;
  Calibration truth_;
  InertialWindow window_;
};

}  // namespace cocalib::test
