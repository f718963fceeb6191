#include "cocalib/monitor/mounting_watch.h"

#include <gtest/gtest.h>

#include "monitor/watched_rig.h"

namespace cocalib {
namespace {

using test::FoundChange;
using test::WatchedRig;

// A piece of 6 s that the change comes too late to show in, one that shows it, 3 s of the next.
constexpr double kLatestS = 11.0;

sim::Scenario lasting(double duration_s) {
  sim::Scenario s;
  s.duration_s = duration_s;
  return s;
}

/// Both sensors where they were, every parameter known to this; errors as a calibrator makes them that believes itself
/// a third too certain.
CalibrationEstimate piece(const CalibrationEstimate& calibrated, double sigma_m, double sigma_rad,
                          sim::Random* random) {
  constexpr double kOverconfidence = 1.3;
  Vector6d sigma;
  sigma << Eigen::Vector3d::Constant(sigma_m), Eigen::Vector3d::Constant(sigma_rad);
  CalibrationEstimate now = calibrated;
  now.covariance.setZero();
  now.covariance.block<6, 6>(0, 0) = now.covariance.block<6, 6>(6, 6) = sigma.cwiseAbs2().asDiagonal();
  for (Pose* pose : {&now.calibration.T_imu_camera, &now.calibration.T_imu_lidar}) {
    Vector6d error;
    error << sigma_m * random->normal3(), sigma_rad * random->normal3();
    *pose = pose->plus(kOverconfidence * error);
  }
  return now;
}

TEST(MountingComparison, IsSilentOverManyPiecesHoweverLittleTheyShow) {
  CalibrationEstimate calibrated;
  calibrated.camera.valid = calibrated.lidar.valid = true;
  calibrated.covariance.diagonal().setConstant(1e-8);
  const MountingComparison comparison({}, calibrated);
  sim::Random random(5, sim::Random::Stream::kTexture, 4);
  // Ten minutes are 100 pieces. Lively motion shows millimetres, a rig that hardly moves centimetres.
  for (const double sigma_m : {0.0005, 0.002, 0.008, 0.03}) {
    for (int i = 0; i < 100; ++i) {
      const auto changes = comparison.compare(piece(calibrated, sigma_m, 0.3 * sigma_m, &random));
      EXPECT_TRUE(changes.empty()) << sigma_m << ": " << changes.front().words;
    }
  }
}

TEST(MountingComparison, NamesTheSensorAndTheAxisThatSayItMostClearly) {
  CalibrationEstimate calibrated;
  calibrated.camera.valid = calibrated.lidar.valid = true;
  calibrated.covariance.diagonal().setConstant(1e-8);
  const MountingComparison comparison({}, calibrated);
  sim::Random random(5, sim::Random::Stream::kTexture, 5);
  CalibrationEstimate now = piece(calibrated, 0.001, 0.0003, &random);
  now.calibration.T_imu_lidar.t.y() -= 0.02;
  auto changes = comparison.compare(now);
  ASSERT_EQ(changes.size(), 1U);
  EXPECT_EQ(changes[0].sensor, "lidar");
  EXPECT_NE(changes[0].words.find("mm along imu y"), std::string::npos) << changes[0].words;
  // What a piece does not know it does not say.
  EXPECT_TRUE(comparison.compare(piece(now, 0.01, 0.01, &random)).empty());
  now.lidar.valid = false;
  EXPECT_TRUE(comparison.compare(now).empty());
}

TEST(MountingWatch, NamesACameraThatHasTurned) {
  WatchedRig rig(lasting(17.0));
  // 0.5 deg about the IMU's y axis.
  const Pose T = rig.after().camera.T_imu_camera();
  const double angle = 0.5 * M_PI / 180.0;
  rig.after().camera.mounting_rpy.y() += angle;
  const Vector6d moved = rig.after().camera.T_imu_camera().minus(T);
  const auto found = rig.run(6.0);
  ASSERT_FALSE(found.empty());
  EXPECT_LT(found.front().time_s, 6.0 + kLatestS);
  for (const auto& [time, change] : found) {
    EXPECT_GT(time, 6.0);
    EXPECT_EQ(change.sensor, "camera") << change.words;
    EXPECT_NE(change.words.find("turned"), std::string::npos) << change.words;
  }
  // A piece after the change shows all of it.
  const MountingChange& last = found.back().change;
  EXPECT_LT((last.change - moved).tail<3>().norm(), 0.1 * angle) << last.change.transpose();
  EXPECT_NE(last.words.find("deg about imu y"), std::string::npos) << last.words;
}

TEST(MountingWatch, NamesALidarThatHasShifted) {
  WatchedRig rig(lasting(17.0));
  rig.after().lidar.translation.z() += 0.02;
  const auto found = rig.run(6.0);
  ASSERT_FALSE(found.empty());
  EXPECT_LT(found.front().time_s, 6.0 + kLatestS);
  for (const auto& [time, change] : found) {
    EXPECT_GT(time, 6.0);
    EXPECT_EQ(change.sensor, "lidar") << change.words;
  }
  EXPECT_NEAR(found.back().change.change.z(), 0.02, 0.003);
  EXPECT_NE(found.back().change.words.find("mm along imu z"), std::string::npos) << found.back().change.words;
}

TEST(MountingWatch, IsSilentWhileNothingChanges) {
  sim::Scenario s = lasting(30.0);
  s.seed = 1;  // with planes in some pieces that a single line of points lies on
  WatchedRig rig(s);
  for (const auto& [time, change] : rig.run(1e9)) ADD_FAILURE() << time << " s: " << change.words;
  EXPECT_GE(rig.pieces(), 4);
}

}  // namespace
}  // namespace cocalib
