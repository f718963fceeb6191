#include "cocalib/initialization/motion_rotation.h"

#include <gtest/gtest.h>

#include "initialization/simulated_rig.h"

namespace cocalib {
namespace {

using test::SimulatedRig;

constexpr double kPositionSigma_m = 0.01, kRotationSigma_rad = 0.002;

/// What a lidar odometry gives: 10 Hz, in a map that is turned and shifted at random against the world.
std::vector<SensorPose> posesOf(const SimulatedRig& rig) {
  const Pose T_M_W{expSo3({0.7, -1.1, 2.0}), {3.0, -1.0, 0.4}};
  sim::Random random(rig.scenario.seed, sim::Random::Stream::kTracks, 5);
  std::vector<SensorPose> poses;
  for (const TimeNs stamp : rig.stamps(10.0)) {
    Pose pose = T_M_W * rig.T_W_S(stamp);
    pose.t += kPositionSigma_m * random.normal3();
    pose.q = pose.q * expSo3(kRotationSigma_rad * random.normal3());
    poses.push_back({stamp, pose});
  }
  return poses;
}

void expectFound(const SimulatedRig& rig, const std::vector<SensorPose>& poses, double offset_tolerance_s) {
  std::string reason;
  const auto found = rotationFromMotion(rig.imu, poses, 0.02, {}, &reason);
  ASSERT_TRUE(found) << reason;
  const double error = test::angleBetween(found->R_imu_sensor, rig.T_I_S.q);
  EXPECT_LT(error, 0.03);
  EXPECT_LT(error, 4.0 * found->rotation_sigma_rad);
  EXPECT_NEAR(found->time_offset_s, rig.offset_s, offset_tolerance_s);
  EXPECT_LT((found->gyro_bias - rig.bias.gyro).norm(), 0.003);
}

TEST(MotionRotation, IsFoundWhereTheRigTurnsAboutOneAxisOnly) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    for (const sim::Motion motion : {sim::Motion::kPlanar, sim::Motion::kUpright}) {
      const SimulatedRig rig(motion, seed, 10.0, test::mountings()[seed - 1], 0.03);
      SCOPED_TRACE(seed);
      expectFound(rig, posesOf(rig), 0.004);
    }
  }
}

TEST(MotionRotation, IsFoundFromAccelerationsAlone) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const SimulatedRig rig(sim::Motion::kTranslationOnly, seed, 10.0, test::mountings()[seed - 1], -0.05);
    SCOPED_TRACE(seed);
    expectFound(rig, posesOf(rig), 0.006);
  }
}

TEST(MotionRotation, SurvivesPosesThatAreGrosslyWrong) {
  const SimulatedRig rig(sim::Motion::kPlanar, 2, 10.0, test::mountings()[3], 0.03);
  std::vector<SensorPose> poses = posesOf(rig);
  for (std::size_t i = 5; i < poses.size(); i += 20) poses[i].T_M_S.t.x() += 0.5;
  expectFound(rig, poses, 0.005);
}

TEST(MotionRotation, IsRefusedWhereNothingShowsIt) {
  const Pose mounting = test::mountings()[1];
  std::string reason;
  const SimulatedRig still(sim::Motion::kStatic, 1, 10.0, mounting, 0.0);
  EXPECT_FALSE(rotationFromMotion(still.imu, posesOf(still), 0.02, {}, &reason));
  EXPECT_NE(reason.find("rotate about imu"), std::string::npos) << reason;

  // Shifted along one line: a turn about that line changes nothing.
  SimulatedRig line(sim::Motion::kTranslationOnly, 1, 10.0, mounting, 0.0);
  std::vector<SensorPose> poses = posesOf(line);
  ImuBuffer imu;
  const Eigen::Vector3d up(0.0, 0.0, 9.80665), along = Eigen::Vector3d(1.0, 2.0, 0.5).normalized();
  for (ImuSample sample : line.imu.samples()) {
    sample.accel = up + along * (sample.accel - up).dot(along);
    imu.push(sample);
  }
  const Eigen::Quaterniond R_M_I = poses.front().T_M_S.q * mounting.q.conjugate();
  const Eigen::Vector3d along_M = R_M_I * along;
  for (SensorPose& pose : poses) pose.T_M_S.t = along_M * pose.T_M_S.t.dot(along_M);
  EXPECT_FALSE(rotationFromMotion(imu, poses, 0.02, {}, &reason));

  EXPECT_FALSE(rotationFromMotion(imu, {}, 0.02, {}, &reason));
  EXPECT_FALSE(rotationFromMotion(ImuBuffer(), poses, 0.02, {}, &reason));
}

}  // namespace
}  // namespace cocalib
