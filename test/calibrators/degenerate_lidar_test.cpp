// Motion that leaves a part of the mounting open, and no guess: what is open is flagged and held, what is not is found.
#include "calibrators/degenerate_motion.h"
#include "cocalib/calibrators/cocalibration_fuser.h"
#include "cocalib/calibrators/lidar_inertial_calibrator.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

CalibrationEstimate estimateOf(const sim::Scenario& s, bool may_converge = false) {
  const sim::Scene scene(s);
  const sim::Trajectory trajectory(s);
  LidarInertialCalibrator calibrator(LidarInertialParams(), test::noiseOf(s), std::nullopt);
  for (const ImuSample& sample : sim::simulateImu(s, trajectory)) calibrator.addImu(sample);
  for (int k = 0; k < sim::scanCount(s); ++k) {
    calibrator.addScan(sim::simulateScan(s, scene, trajectory, k).scan);
    EXPECT_TRUE(may_converge || calibrator.estimate().status != Status::kConverged);
  }
  calibrator.flush();
  return calibrator.estimate();
}

CalibrationEstimate expectOnlyOpen(const sim::Scenario& s, const std::vector<int>& open) {
  const CalibrationEstimate estimate = estimateOf(s);
  EXPECT_EQ(estimate.status, Status::kUnobservable) << estimate.message;
  test::expectOnlyOpen(estimate.lidar, estimate.calibration.T_imu_lidar.minus(s.lidar.T_imu_lidar()), open, 5e-3);
  EXPECT_NEAR(estimate.calibration.lidar_time_offset_s, s.lidar.time_offset_s, 5e-4);
  return estimate;
}

/// Nothing is known: a broad prior, which says so.
void expectAllOpen(const sim::Scenario& s, const std::string& reason) {
  const CalibrationEstimate estimate = estimateOf(s);
  EXPECT_EQ(estimate.status, Status::kUnobservable);
  test::expectOnlyOpen(estimate.lidar, estimate.calibration.T_imu_lidar.minus(s.lidar.T_imu_lidar()),
                       {0, 1, 2, 3, 4, 5}, 0.0);
  EXPECT_NE(estimate.message.find(reason), std::string::npos) << estimate.message;
}

TEST(DegenerateLidar, PlanarMotionLeavesTheVerticalLeverArmOpen) {
  for (const std::uint64_t seed : {2, 3}) expectOnlyOpen(test::scenarioOf(sim::Motion::kPlanar, seed, 20.0), {2});
}

TEST(DegenerateLidar, SoDoesMotionThatNeverTilts) {
  expectOnlyOpen(test::scenarioOf(sim::Motion::kUpright, 2, 14.0), {2});
}

TEST(DegenerateLidar, ShiftingWithoutTurningLeavesTheWholeLeverArmOpen) {
  expectOnlyOpen(test::scenarioOf(sim::Motion::kTranslationOnly, 2, 20.0), {0, 1, 2});
}

TEST(DegenerateLidar, NorDoTheTiltAndTheBiasThatNothingTellsApartRunAway) {
  const sim::Scenario s = test::scenarioOf(sim::Motion::kTranslationOnly, 1, 30.0);
  const CalibrationEstimate estimate = expectOnlyOpen(s, {0, 1, 2});
  EXPECT_NEAR(estimate.gravity, s.gravity, 5e-3);
  EXPECT_LT(estimate.accel_bias.norm(), 0.03);
}

TEST(DegenerateLidar, StandingStillShowsNothing) {
  expectAllOpen(test::scenarioOf(sim::Motion::kStatic, 1, 12.0), "rotate about imu");
}

TEST(DegenerateLidar, ASingleWallShowsNoWholeRotation) {
  sim::Scenario s = test::scenarioOf(sim::Motion::kFull, 2, 12.0);
  s.place = sim::Place::kWall;
  s.board.present = false;
  expectAllOpen(s, "face one way");
}

TEST(DegenerateLidar, ACorridorHidesOnlyTheWayAlongIt) {
  sim::Scenario s = test::scenarioOf(sim::Motion::kFull, 2, 14.0);
  s.place = sim::Place::kCorridor;
  s.board.present = false;
  const CalibrationEstimate estimate = estimateOf(s, true);
  test::expectOnlyOpen(estimate.lidar, estimate.calibration.T_imu_lidar.minus(s.lidar.T_imu_lidar()), {}, 10e-3);
  s.motion = sim::Motion::kPlanar;
  expectOnlyOpen(s, {2});
}

// Which tilt of the world is that of a rig that does not speed up along the corridor, nothing tells. It must not swing.
TEST(DegenerateLidar, TheTiltThatACorridorHidesDoesNotSpoilTheJointEstimate) {
  sim::Scenario s = test::scenarioOf(sim::Motion::kFull, 9, 14.0);
  s.place = sim::Place::kCorridor;
  s.board.present = false;
  s.lidar.time_offset_s = -0.015;
  const sim::Scene scene(s);
  const sim::Trajectory trajectory(s);
  LidarInertialCalibrator calibrator(LidarInertialParams(), test::noiseOf(s), std::nullopt);
  FuserInputs inputs;
  inputs.lidar = true;
  CoCalibrationFuser fuser(FuserParams(), test::noiseOf(s), inputs);
  for (const ImuSample& sample : sim::simulateImu(s, trajectory)) {
    calibrator.addImu(sample);
    fuser.addImu(sample);
  }
  sim::Scenario other_noise = s;  // on the same motion: noise that let it swing
  other_noise.seed = 102;
  int estimates = 0;
  for (int k = 0; k < sim::scanCount(s); ++k) {
    const LidarScan scan = sim::simulateScan(other_noise, scene, trajectory, k).scan;
    for (LidarKeyframe& keyframe : calibrator.addScan(scan)) fuser.addLidar(std::move(keyframe));
    fuser.setLidarEstimate(calibrator.estimate());
    if (!fuser.wantsSolve() || !fuser.solve()) continue;
    const CalibrationEstimate estimate = fuser.estimate();
    ASSERT_TRUE(estimate.lidar.valid) << estimate.message;
    const Vector6d error = estimate.calibration.T_imu_lidar.minus(s.lidar.T_imu_lidar());
    EXPECT_LT(error.cwiseQuotient(estimate.lidar.sigma).cwiseAbs().maxCoeff(), 4.0) << "after " << 0.1 * k << " s";
    ++estimates;
  }
  EXPECT_GE(estimates, 8);
  EXPECT_EQ(fuser.diagnostics().counts["restarts after failure"], 0U);
}

}  // namespace
}  // namespace cocalib
