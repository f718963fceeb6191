#include <gtest/gtest.h>

#include <cmath>
#include <utility>
#include <vector>

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/calibrators/visual_inertial_calibrator.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

constexpr int kPictureStep = 3;  // of the camera's 50 Hz, as many as the calibrator takes

/// The three calibrators on a rig that is moved and then stands, with board, features and sweeps.
class ParkedRig {
 public:
  explicit ParkedRig(const sim::Scenario& s)
      : s_(s),
        scene_(s),
        trajectory_(s),
        tracks_(s, scene_, trajectory_),
        noise_{s.imu.gyro_noise_density, 1e-6, s.imu.accel_noise_density, 1e-5},
        visual_(VisualInertialParams(), noise_, s.camera.cameraModel(), s.board.geometry(), {}),
        lidar_(LidarInertialParams(), noise_, {}),
        fuser_(FuserParams(), noise_, inputs()) {}

  CalibrationEstimate run() {
    for (const ImuSample& sample : sim::simulateImu(s_, trajectory_)) {
      visual_.addImu(sample);
      lidar_.addImu(sample);
      fuser_.addImu(sample);
    }
    const double pictures_per_sweep = s_.camera.rate_hz / s_.lidar.rate_hz;
    int picture = 0;
    for (int k = 0; k < sim::scanCount(s_); ++k) {
      for (; picture < pictures_per_sweep * (k + 1) && picture < sim::imageCount(s_); picture += kPictureStep)
        addPicture(picture);
      take(lidar_.addScan(sim::simulateScan(s_, scene_, trajectory_, k).scan));
    }
    take(visual_.flush());
    take(lidar_.flush());
    fuser_.finish();
    return fuser_.estimate();
  }

 private:
  FuserInputs inputs() const {
    FuserInputs inputs;
    inputs.camera = s_.camera.cameraModel();
    inputs.board = s_.board.geometry();
    inputs.lidar = true;
    return inputs;
  }
  void addPicture(int k) {
    VisualKeyframe seen;
    seen.stamp = sim::imageStamp(s_, k);
    seen.board = sim::simulateBoard(s_, scene_, trajectory_, k);
    seen.tracks = tracks_.observe(k);
    take(visual_.addMeasurements(std::move(seen)));
  }
  void take(std::vector<VisualKeyframe> keyframes) {
    for (VisualKeyframe& keyframe : keyframes) fuser_.addVisual(std::move(keyframe));
    fuser_.setVisualEstimate(visual_.estimate());
    solve();
  }
  void take(std::vector<LidarKeyframe> keyframes) {
    for (LidarKeyframe& keyframe : keyframes) fuser_.addLidar(std::move(keyframe));
    fuser_.setLidarEstimate(lidar_.estimate());
    solve();
  }
  void solve() {
    if (!fuser_.wantsSolve() || !fuser_.solve()) return;
    visual_.setJointCalibration(fuser_.estimate().calibration);
    lidar_.setJointCalibration(fuser_.estimate().calibration);
  }

  sim::Scenario s_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
  sim::TrackSimulator tracks_;
  ImuNoise noise_;
  VisualInertialCalibrator visual_;
  LidarInertialCalibrator lidar_;
  CoCalibrationFuser fuser_;
};

// Views from one place show no depth. Features that went anywhere for it kept the last round from taking a single step,
// and with more steps made the standing rig outweigh the motion: 5 sigmas, called converged.
TEST(ParkedRig, StaysAsWellCalibratedAsItWas) {
  for (const std::uint64_t seed : {2U, 4U}) {
    sim::Scenario s;
    s.seed = seed;
    s.duration_s = 27.0;
    s.parked_after_s = 12.0;
    const CalibrationEstimate estimate = ParkedRig(s).run();
    ASSERT_TRUE(estimate.camera.valid && estimate.lidar.valid) << estimate.message;
    Vector14d error;
    error << estimate.calibration.T_imu_camera.minus(s.camera.T_imu_camera()),
        estimate.calibration.T_imu_lidar.minus(s.lidar.T_imu_lidar()), estimate.calibration.camera_time_offset_s,
        estimate.calibration.lidar_time_offset_s;
    for (int i = 0; i < 14; ++i) {
      EXPECT_LT(std::abs(error[i]), 3.5 * std::sqrt(estimate.covariance(i, i))) << seed << ", axis " << i;
    }
    EXPECT_LT(error.dot(estimate.covariance.ldlt().solve(error)), 36.1)
        << seed;  // 99.9 % of chi-square with 14 degrees
  }
}

}  // namespace
}  // namespace cocalib
