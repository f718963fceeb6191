#include "cocalib/calibrators/lidar_inertial_calibrator.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <set>

#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

/// A simulated recording that is played into one or more calibrators, sweep by sweep.
class Recording {
 public:
  explicit Recording(const sim::Scenario& s)
      : scenario_(s), scene_(s), trajectory_(s), imu_(sim::simulateImu(s, trajectory_)) {}

  std::unique_ptr<LidarInertialCalibrator> makeCalibrator() const {
    const ImuNoise noise{scenario_.imu.gyro_noise_density, 1e-6, scenario_.imu.accel_noise_density, 1e-5};
    auto calibrator = std::make_unique<LidarInertialCalibrator>(LidarInertialParams(), noise, std::nullopt);
    for (const ImuSample& sample : imu_) calibrator->addImu(sample);
    return calibrator;
  }
  int sweeps() const { return sim::scanCount(scenario_); }
  LidarScan sweep(int k) const { return sim::simulateScan(scenario_, scene_, trajectory_, k).scan; }
  Vector6d errorOf(const CalibrationEstimate& estimate) const {
    return estimate.calibration.T_imu_lidar.minus(scenario_.lidar.T_imu_lidar());
  }

 private:
  sim::Scenario scenario_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
  std::vector<ImuSample> imu_;
};

// Feedback changes where the calibrator deskews and linearises; it is not information. An error in it must be gone with
// the next estimate.
TEST(LidarInertialCalibrator, NothingOfAWrongFeedbackSurvives) {
  sim::Scenario s;
  s.duration_s = 10.0;
  const Recording recording(s);
  const auto misled = recording.makeCalibrator(), twin = recording.makeCalibrator();
  int k = 0;
  const auto addSweep = [&] {
    const LidarScan sweep = recording.sweep(k++);
    misled->addScan(sweep);
    twin->addScan(sweep);
  };
  while (k < 70) addSweep();
  ASSERT_TRUE(misled->estimate().lidar.valid);
  const TimeNs before = misled->estimate().stamp;
  const double kTurn = 0.0349, kShift = 0.05;  // 2 deg, 5 cm
  Vector6d wrong;
  wrong << kShift * Eigen::Vector3d(0.6, 0.0, -0.8), kTurn * Eigen::Vector3d(0.0, 0.8, 0.6);
  Calibration feedback = misled->estimate().calibration;
  feedback.T_imu_lidar = feedback.T_imu_lidar.plus(wrong);
  misled->setJointCalibration(feedback);
  while (misled->estimate().stamp == before && k < recording.sweeps()) addSweep();
  ASSERT_GT(misled->estimate().stamp, before);
  ASSERT_EQ(misled->estimate().stamp, twin->estimate().stamp);
  const Vector6d left = misled->estimate().calibration.T_imu_lidar.minus(twin->estimate().calibration.T_imu_lidar);
  EXPECT_LT(left.head<3>().norm(), 0.05 * kShift);
  EXPECT_LT(left.tail<3>().norm(), 0.05 * kTurn);
}

// Solves that stop short, or sums that are biased, show here first: the prior keeps them for ever.
TEST(LidarInertialCalibrator, CovarianceIsHonestAfterMarginalization) {
  double sum = 0.0;
  constexpr int kSeeds = 3;
  for (int seed = 1; seed <= kSeeds; ++seed) {
    sim::Scenario s;
    s.seed = static_cast<std::uint64_t>(seed);
    s.duration_s = 9.0;
    const Recording recording(s);
    const auto calibrator = recording.makeCalibrator();
    for (int k = 0; k < recording.sweeps(); ++k) calibrator->addScan(recording.sweep(k));
    const CalibrationEstimate estimate = calibrator->estimate();
    ASSERT_TRUE(estimate.lidar.valid);
    const Vector6d error = recording.errorOf(estimate);
    sum += error.dot(estimate.covariance.block<6, 6>(6, 6).ldlt().solve(error));
  }
  EXPECT_LT(sum / kSeeds, 14.1);  // 99.9 % of the mean of three chi-squares with 6 degrees
}

TEST(LidarInertialCalibrator, VersionsChangeBetweenCloudsOnly) {
  sim::Scenario s;
  s.duration_s = 8.0;
  const Recording recording(s);
  const auto calibrator = recording.makeCalibrator();
  std::uint32_t last = 0;
  std::set<std::uint32_t> seen;
  for (int k = 0; k < recording.sweeps(); ++k) {
    calibrator->addScan(recording.sweep(k));
    const auto cloud = calibrator->deskewedCloud();
    if (!cloud) continue;
    EXPECT_GE(cloud->calibration_version, last);
    // The same version, the same calibration.
    const auto again = calibrator->deskewedCloud();
    EXPECT_EQ(again->calibration_version, cloud->calibration_version);
    EXPECT_EQ(again->points_W, cloud->points_W);
    last = cloud->calibration_version;
    seen.insert(last);
    calibrator->setJointCalibration(cloud->calibration);
    EXPECT_GT(calibrator->deskewedCloud()->calibration_version, last);
  }
  EXPECT_GT(seen.size(), 3U);
}

// Whoever shows the sweeps need not wait for a solve, nor see only those with their planes that one has just followed.
TEST(LidarInertialCalibrator, ShowsEverySweepWithItsPlanesBeforeItSolves) {
  sim::Scenario s;
  s.duration_s = 8.0;
  const Recording recording(s);
  const auto calibrator = recording.makeCalibrator();
  int since_start = 0, shown = 0;
  for (int k = 0; k < recording.sweeps(); ++k) {
    const TimeNs before = calibrator->estimate().stamp;
    if (calibrator->deskewedCloud()) ++since_start;
    const LidarScan sweep = recording.sweep(k);
    calibrator->addScan(sweep, [&] {
      EXPECT_EQ(calibrator->estimate().stamp, before);
      const auto cloud = calibrator->deskewedCloud();
      ASSERT_TRUE(cloud);
      const auto on_planes = std::count_if(cloud->plane.begin(), cloud->plane.end(), [](int p) { return p >= 0; });
      // Every third point is looked at, of which half and more lie on planes.
      EXPECT_GT(6 * on_planes, static_cast<std::ptrdiff_t>(cloud->plane.size())) << k;
      ++shown;
    });
  }
  EXPECT_GT(since_start, 20);
  EXPECT_GE(shown, since_start);
}

// Through three of the building's rooms: the walls of the first are out of sight long before the end.
TEST(LidarInertialCalibrator, GoesOnThroughOtherRooms) {
  sim::Scenario s;
  s.place = sim::Place::kBuilding;
  s.duration_s = 24.0;
  const Recording recording(s);
  const auto calibrator = recording.makeCalibrator();
  for (int k = 0; k < recording.sweeps(); ++k) {
    calibrator->addScan(recording.sweep(k));
    if (!calibrator->estimate().lidar.valid) continue;
    EXPECT_GE(calibrator->diagnostics().counts["planes"], 6U) << k;
    EXPECT_LE(calibrator->diagnostics().counts["planes"], 60U) << k;
  }
  const CalibrationEstimate estimate = calibrator->estimate();
  ASSERT_TRUE(estimate.lidar.valid);
  EXPECT_EQ(estimate.status, Status::kConverged) << estimate.message;
  const Vector6d error = recording.errorOf(estimate);
  const Matrix6d P = estimate.covariance.block<6, 6>(6, 6);
  EXPECT_LT(error.dot(P.ldlt().solve(error)), 22.5);  // 99.9 % of chi-square with 6 degrees
  EXPECT_LT(error.head<3>().norm(), 3e-3);
  EXPECT_LT(error.tail<3>().norm(), 1e-3);
}

}  // namespace
}  // namespace cocalib
