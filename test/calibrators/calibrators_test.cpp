#include <gtest/gtest.h>

#include <algorithm>

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/calibrators/visual_inertial_calibrator.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/renderer.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

ImuNoise noiseOf(const sim::Scenario& scenario) {
  return {scenario.imu.gyro_noise_density, 1e-6, scenario.imu.accel_noise_density, 1e-5};
}

/// All sweeps of a scenario through the calibrator and on into a fuser.
struct LidarRun {
  LidarRun(const sim::Scenario& s, CoCalibrationFuser* fuser)
      : calibrator(LidarInertialParams(), noiseOf(s), std::nullopt) {
    const sim::Scene scene(s);
    const sim::Trajectory trajectory(s);
    for (const ImuSample& sample : sim::simulateImu(s, trajectory)) {
      calibrator.addImu(sample);
      if (fuser) fuser->addImu(sample);
    }
    for (int k = 0; k < sim::scanCount(s); ++k) {
      take(calibrator.addScan(sim::simulateScan(s, scene, trajectory, k).scan), fuser);
    }
    take(calibrator.flush(), fuser);
  }
  void take(std::vector<LidarKeyframe> keyframes, CoCalibrationFuser* fuser) {
    count += keyframes.size();
    if (!fuser) return;
    for (LidarKeyframe& keyframe : keyframes) fuser->addLidar(std::move(keyframe));
    fuser->setLidarEstimate(calibrator.estimate());
    while (fuser->wantsSolve() && fuser->solve()) {
      const TimeNs stamp = fuser->estimate().stamp;
      if (++solves > 1) longest_wait_s = std::max(longest_wait_s, toSeconds(stamp - newest));
      newest = stamp;
    }
  }
  LidarInertialCalibrator calibrator;
  std::size_t count = 0, solves = 0;
  double longest_wait_s = 0.0;  ///< data time between two solves of the fuser
  TimeNs newest = 0;
};

TEST(LidarInertialCalibrator, StartsFromNothingInAnyMounting) {
  for (const Eigen::Vector3d& rpy :
       {Eigen::Vector3d(0.16, 0.16, 0.16), Eigen::Vector3d(3.1, 0.1, -0.2), Eigen::Vector3d(1.6, 0.0, 0.8)}) {
    sim::Scenario s;
    s.duration_s = 10.0;
    s.lidar.mounting_rpy = rpy;
    s.lidar.translation = {0.3, -0.3, 0.25};
    s.lidar.time_offset_s = -0.015;
    LidarRun run(s, nullptr);
    const CalibrationEstimate estimate = run.calibrator.estimate();
    ASSERT_TRUE(estimate.lidar.valid) << rpy.transpose() << ": " << estimate.message;
    const Vector6d error = estimate.calibration.T_imu_lidar.minus(s.lidar.T_imu_lidar());
    EXPECT_LT(error.head<3>().norm(), 5e-3) << rpy.transpose();
    EXPECT_LT(error.tail<3>().norm(), 1.7e-3) << rpy.transpose();
    EXPECT_NEAR(estimate.calibration.lidar_time_offset_s, -0.015, 5e-4);
    ASSERT_TRUE(run.calibrator.deskewedCloud());
    EXPECT_GT(run.calibrator.deskewedCloud()->calibration_version, 0U);
    EXPECT_GT(run.count, 90U);
  }
}

TEST(LidarInertialCalibrator, SaysWhatIsMissingWhenStandingStill) {
  sim::Scenario s;
  s.duration_s = 7.0;
  s.motion = sim::Motion::kStatic;
  const LidarRun run(s, nullptr);
  EXPECT_EQ(run.calibrator.estimate().status, Status::kInsufficientData);
  EXPECT_FALSE(run.calibrator.estimate().lidar.valid);
  EXPECT_NE(run.calibrator.estimate().message.find("otat"), std::string::npos) << run.calibrator.estimate().message;
}

TEST(CoCalibrationFuser, RunsOnTheLidarAlone) {
  sim::Scenario s;
  s.duration_s = 8.0;
  FuserInputs inputs;
  inputs.lidar = true;
  CoCalibrationFuser fuser(FuserParams(), noiseOf(s), inputs);
  const LidarRun run(s, &fuser);
  fuser.finish();
  const CalibrationEstimate estimate = fuser.estimate();
  EXPECT_TRUE(estimate.lidar.valid);
  EXPECT_FALSE(estimate.camera.valid);
  EXPECT_LT(estimate.calibration.T_imu_lidar.minus(s.lidar.T_imu_lidar()).head<3>().norm(), 3e-3);
  EXPECT_TRUE(fuser.latestState());
  EXPECT_FALSE(fuser.boardPose());
}

TEST(CoCalibrationFuser, RefreshesOnceASecondAndKeepsWhatItForgets) {
  sim::Scenario s;
  s.duration_s = 20.0;
  FuserInputs inputs;
  inputs.lidar = true;
  FuserParams params;
  params.live_window_s = 5.0;
  params.window_s = 10.0;  // the record is shortened on the way
  CoCalibrationFuser fuser(params, noiseOf(s), inputs);
  const LidarRun run(s, &fuser);
  const CalibrationEstimate live = fuser.estimate();
  EXPECT_GE(run.solves, 12U);
  EXPECT_LT(run.longest_wait_s, 1.05);  // a sweep held back by the clock offset's last change cost a whole second
  fuser.finish();
  const CalibrationEstimate last = fuser.estimate();
  EXPECT_EQ(fuser.diagnostics().counts.at("failed solves of the record"), 0U);
  EXPECT_GT(last.duration_s, 14.0);
  for (const CalibrationEstimate& estimate : {live, last}) {
    Vector6d sigma = estimate.covariance.diagonal().segment<6>(6).cwiseSqrt();
    const Vector6d error = estimate.calibration.T_imu_lidar.minus(s.lidar.T_imu_lidar());
    for (int i = 0; i < 6; ++i) EXPECT_LT(std::abs(error[i]), 4.0 * sigma[i]) << i;
    EXPECT_LT(sigma.head<3>().norm(), 1e-3);  // the bound for 20 s and every point is 0.2 mm
  }
  // Every point, and planes from all sweeps: the last word is the more certain one.
  EXPECT_LT(last.covariance.diagonal().segment<3>(6).sum(), live.covariance.diagonal().segment<3>(6).sum());
}

TEST(VisualInertialCalibrator, StartsFromNothingOnRenderedPictures) {
  sim::Scenario s;
  s.duration_s = 6.0;
  s.camera.optical_roll = 3.0;  // upside-down
  s.camera.time_offset_s = 0.02;
  const sim::Scene scene(s);
  const sim::Trajectory trajectory(s);
  const sim::Renderer renderer(s, scene);
  VisualInertialCalibrator calibrator(VisualInertialParams(), noiseOf(s), s.camera.cameraModel(), s.board.geometry(),
                                      std::nullopt);
  for (const ImuSample& sample : sim::simulateImu(s, trajectory)) calibrator.addImu(sample);
  std::size_t keyframes = 0;
  for (int k = 0; k < sim::imageCount(s); k += 2) {
    keyframes += calibrator.addImage({sim::imageStamp(s, k), renderer.render(trajectory, k)}).size();
  }
  keyframes += calibrator.flush().size();
  const CalibrationEstimate estimate = calibrator.estimate();
  ASSERT_TRUE(estimate.camera.valid) << estimate.message;
  const Vector6d error = estimate.calibration.T_imu_camera.minus(s.camera.T_imu_camera());
  EXPECT_LT(error.head<3>().norm(), 5e-3);
  EXPECT_LT(error.tail<3>().norm(), 1.7e-3);
  EXPECT_NEAR(estimate.calibration.camera_time_offset_s, 0.02, 5e-4);
  EXPECT_GT(keyframes, 70U);  // 100 pictures are processed; those before the first state have none
}

TEST(VisualInertialCalibrator, CountsPicturesOfTheWrongSize) {
  const sim::Scenario s;
  VisualInertialCalibrator calibrator(VisualInertialParams(), noiseOf(s), s.camera.cameraModel(), std::nullopt,
                                      std::nullopt);
  EXPECT_TRUE(calibrator.addImage({toNs(1.0), cv::Mat(10, 10, CV_8UC1, cv::Scalar(0))}).empty());
  EXPECT_EQ(calibrator.diagnostics().counts.at("images of the wrong size"), 1U);
}

TEST(Parameters, NameEveryBrokenBound) {
  LidarInertialParams params;
  params.window_s = -1.0;
  params.max_points = 3;
  try {
    params.validate();
    FAIL() << "accepted";
  } catch (const std::invalid_argument& error) {
    const std::string text = error.what();
    EXPECT_NE(text.find("window_s = -1 must be within 2 .. 60"), std::string::npos) << text;
    EXPECT_NE(text.find("max_points"), std::string::npos) << text;
  }
  FuserParams fuser;
  fuser.solve_period_s = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(fuser.validate(), std::invalid_argument);
  VisualInertialParams visual;
  visual.track_rate_hz = 200.0;
  EXPECT_THROW(visual.validate(), std::invalid_argument);
}

}  // namespace
}  // namespace cocalib
