#pragma once

#include <utility>
#include <vector>

#include "cocalib/monitor/mounting_watch.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/random.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib::test {

struct FoundChange {
  double time_s;  ///< data after which it was reported
  MountingChange change;
};

/// Measurements of a rig whose sensors may move at one time, to a watch that knows how they stood before.
class WatchedRig {
 public:
  explicit WatchedRig(const sim::Scenario& scenario) : before_(scenario), after_(scenario) {}
  sim::Scenario& after() { return after_; }

  /// Runs the whole recording. @param change_s  when the sensors move. @return changes in the order of time
  std::vector<FoundChange> run(double change_s) {
    const sim::Scene scene(before_);
    const sim::Trajectory trajectory(before_);
    FuserInputs inputs;
    inputs.camera = before_.camera.cameraModel();
    inputs.board = before_.board.geometry();
    inputs.lidar = true;
    const ImuNoise noise = {before_.imu.gyro_noise_density, 1e-6, before_.imu.accel_noise_density, 1e-5};
    MountingWatch watch(MountingWatch::Params(), FuserParams(), noise, inputs, calibrated());
    const std::vector<ImuSample> imu = sim::simulateImu(before_, trajectory);
    std::size_t next_imu = 0;
    std::vector<FoundChange> found;
    for (int k = 1; k < sim::scanCount(before_) - 1; ++k) {
      const sim::Scenario& now = k * 0.1 < change_s ? before_ : after_;
      LidarKeyframe lidar;
      lidar.scan = sim::simulateScan(now, scene, trajectory, k).scan;
      lidar.state = about(trajectory, lidar.scan.stamp);
      for (; next_imu < imu.size() && imu[next_imu].stamp < lidar.scan.stamp + 200'000'000; ++next_imu) {
        watch.addImu(imu[next_imu]);
      }
      for (int picture = 5 * k; picture < 5 * (k + 1) && picture < sim::imageCount(before_); picture += 2) {
        VisualKeyframe visual;
        visual.stamp = sim::imageStamp(now, picture);
        visual.board = sim::simulateBoard(now, scene, trajectory, picture);
        visual.state = about(trajectory, visual.stamp);
        watch.addVisual(std::move(visual));
      }
      watch.addLidar(std::move(lidar));
      for (MountingChange& change : watch.examine()) found.push_back({k * 0.1, std::move(change)});
    }
    pieces_ = watch.pieces();
    return found;
  }
  int pieces() const { return pieces_; }

 private:
  /// The calibration that is watched: the truth, to a millimetre and half a milliradian.
  CalibrationEstimate calibrated() const {
    CalibrationEstimate estimate;
    estimate.status = Status::kConverged;
    estimate.camera.valid = estimate.lidar.valid = true;
    estimate.calibration.T_imu_camera = before_.camera.T_imu_camera();
    estimate.calibration.T_imu_lidar = before_.lidar.T_imu_lidar();
    estimate.covariance.diagonal().setConstant(1e-6 / 4.0);
    return estimate;
  }
  /// What a calibrator would know of the IMU's state.
  NavState about(const sim::Trajectory& trajectory, TimeNs stamp) {
    NavState state = trajectory.stateAt(stamp);
    Vector6d error;
    error << 0.01 * random_.normal3(), 0.003 * random_.normal3();
    state.T_W_I = state.T_W_I.plus(error);
    return state;
  }

  sim::Scenario before_, after_;
  sim::Random random_{5, sim::Random::Stream::kTexture, 3};
  int pieces_ = 0;
};

}  // namespace cocalib::test
