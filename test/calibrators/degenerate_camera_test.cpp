// As degenerate_lidar_test, for the camera and for both sensors together.
#include "calibrators/degenerate_motion.h"
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

constexpr int kEveryThird = 3;  // of 50 pictures per second

/// A camera whose corners and tracks come without pictures.
class Recording {
 public:
  Recording(const sim::Scenario& s, bool board)
      : s_(s),
        board_(board),
        scene_(s),
        trajectory_(s),
        tracks_(s, scene_, trajectory_),
        camera_(VisualInertialParams(), test::noiseOf(s), s.camera.cameraModel(), geometry(), std::nullopt) {
    for (const ImuSample& sample : imu()) camera_.addImu(sample);
  }

  std::vector<ImuSample> imu() const { return sim::simulateImu(s_, trajectory_); }
  std::optional<BoardGeometry> geometry() const {
    return board_ ? std::optional<BoardGeometry>(s_.board.geometry()) : std::nullopt;
  }
  int pictures() const { return sim::imageCount(s_); }
  std::vector<VisualKeyframe> addPicture(int k) {
    VisualKeyframe seen;
    seen.stamp = sim::imageStamp(s_, k);
    if (board_) seen.board = sim::simulateBoard(s_, scene_, trajectory_, k);
    seen.tracks = tracks_.observe(k);
    std::vector<VisualKeyframe> keyframes = camera_.addMeasurements(std::move(seen));
    EXPECT_NE(camera_.estimate().status, Status::kConverged);
    return keyframes;
  }
  LidarScan sweep(int k) const { return sim::simulateScan(s_, scene_, trajectory_, k).scan; }
  VisualInertialCalibrator& camera() { return camera_; }

 private:
  sim::Scenario s_;
  bool board_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
  sim::TrackSimulator tracks_;
  VisualInertialCalibrator camera_;
};

CalibrationEstimate estimateOf(const sim::Scenario& s, bool board) {
  Recording recording(s, board);
  for (int k = 0; k < recording.pictures(); k += kEveryThird) recording.addPicture(k);
  recording.camera().flush();
  return recording.camera().estimate();
}

void expectOnlyOpen(const sim::Scenario& s, bool board, const std::vector<int>& open, double small) {
  const CalibrationEstimate estimate = estimateOf(s, board);
  EXPECT_EQ(estimate.status, Status::kUnobservable) << estimate.message;
  test::expectOnlyOpen(estimate.camera, estimate.calibration.T_imu_camera.minus(s.camera.T_imu_camera()), open, small);
}

TEST(DegenerateCamera, PlanarMotionLeavesTheVerticalLeverArmOpen) {
  expectOnlyOpen(test::scenarioOf(sim::Motion::kPlanar, 2, 16.0), true, {2}, 10e-3);
}

TEST(DegenerateCamera, ShiftingWithoutTurningLeavesTheWholeLeverArmOpen) {
  expectOnlyOpen(test::scenarioOf(sim::Motion::kTranslationOnly, 2, 16.0), true, {0, 1, 2}, 10e-3);
}

// The solver takes noise for a scale, and a lever arm of no known length draws the whole scene to a point.
TEST(DegenerateCamera, TurningOnTheSpotShowsNoScaleWithoutABoard) {
  for (const std::uint64_t seed : {4, 6}) {
    expectOnlyOpen(test::scenarioOf(sim::Motion::kRotationOnly, seed, 20.0), false, {0, 1, 2, 3, 4, 5}, 0.0);
  }
}

TEST(DegenerateCamera, StandingStillShowsNothing) {
  for (const bool board : {true, false}) {
    expectOnlyOpen(test::scenarioOf(sim::Motion::kStatic, 1, 10.0), board, {0, 1, 2, 3, 4, 5}, 0.0);
  }
}

TEST(DegenerateCamera, WithoutPicturesThereIsNoVerdict) {
  Recording recording(test::scenarioOf(sim::Motion::kStatic, 1, 12.0), false);
  for (int k = 0; k < recording.pictures(); k += kEveryThird) {
    VisualKeyframe dark;
    dark.stamp = toNs(1.7e9) + toNs(0.02) * k;
    recording.camera().addMeasurements(dark);
  }
  EXPECT_EQ(recording.camera().estimate().status, Status::kInsufficientData);
  EXPECT_FALSE(recording.camera().estimate().camera.valid);
}

/// Both calibrators and the fuser.
CalibrationEstimate jointEstimateOf(const sim::Scenario& s) {
  Recording recording(s, true);
  LidarInertialCalibrator lidar(LidarInertialParams(), test::noiseOf(s), std::nullopt);
  CoCalibrationFuser fuser(FuserParams(), test::noiseOf(s), {s.camera.cameraModel(), true, s.board.geometry()});
  for (const ImuSample& sample : recording.imu()) {
    lidar.addImu(sample);
    fuser.addImu(sample);
  }
  const int pictures_per_sweep = 5;
  for (int k = 0; k < sim::scanCount(s); ++k) {
    for (int i = k * pictures_per_sweep; i < (k + 1) * pictures_per_sweep; ++i) {
      if (i % kEveryThird != 0) continue;
      for (VisualKeyframe& keyframe : recording.addPicture(i)) fuser.addVisual(std::move(keyframe));
    }
    for (LidarKeyframe& keyframe : lidar.addScan(recording.sweep(k))) fuser.addLidar(std::move(keyframe));
    fuser.setVisualEstimate(recording.camera().estimate());
    fuser.setLidarEstimate(lidar.estimate());
    while (fuser.wantsSolve() && fuser.solve()) {
    }
    EXPECT_NE(fuser.estimate().status, Status::kConverged);
  }
  for (VisualKeyframe& keyframe : recording.camera().flush()) fuser.addVisual(std::move(keyframe));
  for (LidarKeyframe& keyframe : lidar.flush()) fuser.addLidar(std::move(keyframe));
  fuser.finish();
  return fuser.estimate();
}

TEST(DegenerateFuser, PlanarMotionKeepsTheLidarAgainstTheCamera) {
  const sim::Scenario s = test::scenarioOf(sim::Motion::kPlanar, 2, 16.0);
  const CalibrationEstimate estimate = jointEstimateOf(s);
  EXPECT_EQ(estimate.status, Status::kUnobservable) << estimate.message;
  const Pose camera = s.camera.T_imu_camera(), lidar = s.lidar.T_imu_lidar();
  test::expectOnlyOpen(estimate.camera, estimate.calibration.T_imu_camera.minus(camera), {2}, 5e-3);
  test::expectOnlyOpen(estimate.lidar, estimate.calibration.T_imu_lidar.minus(lidar), {2}, 5e-3);
  const Pose error_base = lidar.inverse() * camera;
  test::expectOnlyOpen(estimate.lidar_camera, estimate.calibration.T_lidar_camera().minus(error_base), {}, 3e-3);
}

// The plate's upper and lower edge are crossed at a flat angle only, and they alone tell how it slides along the
// others.
TEST(DegenerateFuser, SoDoesShiftingWithoutTurning) {
  const sim::Scenario s = test::scenarioOf(sim::Motion::kTranslationOnly, 1, 20.0);
  const CalibrationEstimate estimate = jointEstimateOf(s);
  EXPECT_EQ(estimate.status, Status::kUnobservable) << estimate.message;
  const Pose camera = s.camera.T_imu_camera(), lidar = s.lidar.T_imu_lidar();
  test::expectOnlyOpen(estimate.camera, estimate.calibration.T_imu_camera.minus(camera), {0, 1, 2}, 5e-3);
  test::expectOnlyOpen(estimate.lidar, estimate.calibration.T_imu_lidar.minus(lidar), {0, 1, 2}, 5e-3);
  const Pose error_base = lidar.inverse() * camera;
  test::expectOnlyOpen(estimate.lidar_camera, estimate.calibration.T_lidar_camera().minus(error_base), {}, 3e-3);
}

TEST(DegenerateFuser, StandingStillIsRelayed) {
  const CalibrationEstimate estimate = jointEstimateOf(test::scenarioOf(sim::Motion::kStatic, 1, 12.0));
  EXPECT_EQ(estimate.status, Status::kUnobservable);
  EXPECT_EQ(estimate.camera.unobservable.size(), 6U);
  EXPECT_EQ(estimate.lidar.unobservable.size(), 6U);
  EXPECT_EQ(estimate.lidar_camera.unobservable.size(), 6U);
  EXPECT_FALSE(estimate.message.empty());
}

}  // namespace
}  // namespace cocalib
