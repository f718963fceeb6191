#include "cocalib/monitor/mounting_watch.h"

#include <gtest/gtest.h>

#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/lidar.h"
#include "cocalib/sim/random.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

// A piece of 6 s that the change comes too late to show in, one that shows it, 3 s of the next.
constexpr double kLatestS = 11.0;

/// Measurements of a rig whose sensors may move at one time, to a watch that knows how they stood before.
class WatchedRig {
 public:
  explicit WatchedRig(double duration_s) {
    before_.duration_s = duration_s;
    after_ = before_;
  }
  sim::Scenario& after() { return after_; }

  /// Runs the whole recording. @return changes in the order in which they were found, each with the time it was found
  /// at
  std::vector<std::pair<double, MountingChange>> run(double change_s) {
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
    std::vector<std::pair<double, MountingChange>> found;
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
      for (MountingChange& change : watch.examine()) found.emplace_back(k * 0.1, std::move(change));
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
  WatchedRig rig(17.0);
  // 0.5 deg about the IMU's y axis.
  const Pose T = rig.after().camera.T_imu_camera();
  const double angle = 0.5 * M_PI / 180.0;
  rig.after().camera.mounting_rpy.y() += angle;
  const Vector6d moved = rig.after().camera.T_imu_camera().minus(T);
  const auto found = rig.run(6.0);
  ASSERT_FALSE(found.empty());
  EXPECT_LT(found.front().first, 6.0 + kLatestS);
  for (const auto& [time, change] : found) {
    EXPECT_GT(time, 6.0);
    EXPECT_EQ(change.sensor, "camera") << change.words;
    EXPECT_NE(change.words.find("turned"), std::string::npos) << change.words;
  }
  // A piece after the change shows all of it.
  const MountingChange& last = found.back().second;
  EXPECT_LT((last.change - moved).tail<3>().norm(), 0.1 * angle) << last.change.transpose();
  EXPECT_NE(last.words.find("deg about imu y"), std::string::npos) << last.words;
}

TEST(MountingWatch, NamesALidarThatHasShifted) {
  WatchedRig rig(17.0);
  rig.after().lidar.translation.z() += 0.02;
  const auto found = rig.run(6.0);
  ASSERT_FALSE(found.empty());
  EXPECT_LT(found.front().first, 6.0 + kLatestS);
  for (const auto& [time, change] : found) {
    EXPECT_GT(time, 6.0);
    EXPECT_EQ(change.sensor, "lidar") << change.words;
  }
  EXPECT_NEAR(found.back().second.change.z(), 0.02, 0.003);
  EXPECT_NE(found.back().second.words.find("mm along imu z"), std::string::npos) << found.back().second.words;
}

TEST(MountingWatch, IsSilentWhileNothingChanges) {
  WatchedRig rig(20.0);
  for (const auto& [time, change] : rig.run(1e9)) ADD_FAILURE() << time << " s: " << change.words;
  EXPECT_GE(rig.pieces(), 3);
}

}  // namespace
}  // namespace cocalib
