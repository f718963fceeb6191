#include <gtest/gtest.h>

#include "cocalib/initialization/alignment.h"
#include "initialization/simulated_rig.h"

namespace cocalib {
namespace {

using test::SimulatedRig;

/// Poses in a map that is turned and shifted at random against the world.
const Pose kT_M_W{expSo3({0.7, -1.1, 2.0}), {3.0, -1.0, 0.4}};

struct PoseNoise {
  double position_m = 0.01, rotation_rad = 0.003, outlier_share = 0.0;
};

std::vector<SensorPose> noisyPoses(const SimulatedRig& rig, double rate_hz, const PoseNoise& noise) {
  sim::Random random(rig.scenario.seed, sim::Random::Stream::kTracks, 5);
  std::vector<SensorPose> poses;
  for (const TimeNs stamp : rig.stamps(rate_hz)) {
    Pose pose = kT_M_W * rig.T_W_S(stamp);
    pose.t += noise.position_m * random.normal3();
    pose.q = pose.q * expSo3(noise.rotation_rad * random.normal3());
    if (random.uniform() < noise.outlier_share) pose = pose * Pose{expSo3(0.3 * random.normal3()), random.normal3()};
    poses.push_back({stamp, pose});
  }
  return poses;
}

/// What rotation initialisation leaves: some error everywhere.
RotationInitialization roughRotation(const SimulatedRig& rig) {
  sim::Random random(rig.scenario.seed, sim::Random::Stream::kTracks, 6);
  RotationInitialization rotation;
  rotation.R_imu_sensor = expSo3(0.004 * random.normal3()) * rig.T_I_S.q;
  rotation.gyro_bias = rig.bias.gyro + 0.003 * random.normal3();
  rotation.time_offset_s = rig.offset_s + 0.001 * random.normal();
  return rotation;
}

struct Limits {
  double lever_m, velocity, tilt;
};

void expectAligned(const SimulatedRig& rig, const Alignment& found, const Limits& limits) {
  const Eigen::Vector3d lever_error = found.T_imu_sensor.t - rig.T_I_S.t;
  EXPECT_LT(lever_error.norm(), limits.lever_m);
  for (int i = 0; i < 3; ++i) EXPECT_LT(std::abs(lever_error[i]), 4.0 * found.lever_arm_sigma_m[i]) << "axis " << i;
  EXPECT_LT(test::angleBetween(found.T_imu_sensor.q, rig.T_I_S.q), 0.008);
  EXPECT_NEAR(found.time_offset_s, rig.offset_s, 0.006);
  EXPECT_LT((found.gyro_bias - rig.bias.gyro).norm(), 0.002);
  const Pose T_found_true = found.T_W_M * kT_M_W;
  for (const NavState& state : found.states) {
    const NavState truth = rig.trajectory->stateAt(state.stamp);
    EXPECT_LT((state.v_W - T_found_true.q * truth.v_W).norm(), limits.velocity);
    EXPECT_LT((state.T_W_I.t - T_found_true * truth.T_W_I.t).norm(), limits.lever_m + 0.03);
    const Eigen::Vector3d up = state.T_W_I.q.conjugate() * Eigen::Vector3d::UnitZ();
    EXPECT_LT((up - truth.T_W_I.q.conjugate() * Eigen::Vector3d::UnitZ()).norm(), limits.tilt);
  }
}

std::string reasonOfRefusal(const SimulatedRig& rig, const std::vector<SensorPose>& poses) {
  std::string reason;
  EXPECT_FALSE(alignFromPoses(rig.imu, roughRotation(rig), poses, {}, &reason));
  return reason;
}

TEST(AlignFromPoses, FullMotionFromAnyMounting) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const SimulatedRig rig(sim::Motion::kFull, seed, 12.0, test::mountings()[seed - 1], 0.02);
    const auto poses = noisyPoses(rig, 10.0, {});
    std::string reason;
    const auto found = alignFromPoses(rig.imu, roughRotation(rig), poses, {}, &reason);
    ASSERT_TRUE(found) << reason;
    ASSERT_EQ(found->states.size(), poses.size());
    EXPECT_EQ(found->states[7].stamp, poses[7].stamp + toNs(found->time_offset_s));
    expectAligned(rig, *found, {0.03, 0.05, 0.01});
  }
}

// The signal of the lever arm is seven times weaker; the sigma says so.
TEST(AlignFromPoses, MildMotion) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const SimulatedRig rig(sim::Motion::kMild, seed, 15.0, test::mountings()[seed - 1], -0.015);
    std::string reason;
    const auto found = alignFromPoses(rig.imu, roughRotation(rig), noisyPoses(rig, 10.0, {}), {}, &reason);
    ASSERT_TRUE(found) << reason;
    expectAligned(rig, *found, {0.15, 0.06, 0.015});
  }
}

TEST(AlignFromPoses, OutliersAndLargeBiases) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SimulatedRig rig(sim::Motion::kFull, seed, 12.0, test::mountings()[seed], 0.1, 0.08, 0.2);
    std::string reason;
    const auto found =
        alignFromPoses(rig.imu, roughRotation(rig), noisyPoses(rig, 20.0, {0.01, 0.005, 0.15}), {}, &reason);
    ASSERT_TRUE(found) << reason;
    expectAligned(rig, *found, {0.03, 0.06, 0.02});
    EXPECT_LT((found->accel_bias - rig.bias.accel).norm(), 0.15);
  }
}

TEST(AlignFromPoses, WithoutNoiseOnlyTheImuIsLeft) {
  const SimulatedRig rig(sim::Motion::kFull, 3, 12.0, test::mountings()[2], 0.02);
  AlignmentParams params;
  params.position_sigma_m = 0.001;
  const auto found = alignFromPoses(rig.imu, roughRotation(rig), noisyPoses(rig, 20.0, {0.0, 0.0, 0.0}), params);
  ASSERT_TRUE(found);
  // 6e-4 m/s^2/sqrt(Hz) over a chunk of 4 s is 3 mm, and averages over the chunks.
  expectAligned(rig, *found, {0.003, 0.005, 0.001});
}

TEST(AlignFromPoses, NamesTheMissingRotation) {
  const SimulatedRig planar(sim::Motion::kPlanar, 1, 15.0, test::mountings()[0], 0.0);
  const std::string reason = reasonOfRefusal(planar, noisyPoses(planar, 10.0, {}));
  EXPECT_NE(reason.find("translation along imu z"), std::string::npos) << reason;
  EXPECT_NE(reason.find("rotate back and forth about imu x or y"), std::string::npos) << reason;
  for (const sim::Motion motion : {sim::Motion::kStatic, sim::Motion::kTranslationOnly}) {
    const SimulatedRig rig(motion, 1, 15.0, test::mountings()[0], 0.0);
    const std::string why = reasonOfRefusal(rig, noisyPoses(rig, 10.0, {}));
    EXPECT_NE(why.find("rotate back and forth"), std::string::npos) << why;
  }
}

TEST(AlignFromPoses, SaysWhatIsWrongWithTheInput) {
  const SimulatedRig rig(sim::Motion::kFull, 1, 12.0, test::mountings()[0], 0.0);
  auto poses = noisyPoses(rig, 10.0, {});
  EXPECT_NE(reasonOfRefusal(rig, {poses.begin(), poses.begin() + 10}).find("keep moving"), std::string::npos);
  EXPECT_NE(reasonOfRefusal(rig, {poses.begin(), poses.begin() + 20}).find("keep moving"), std::string::npos);
  std::vector<SensorPose> bad = poses;
  bad[20].T_M_S.t.x() = std::nan("");
  EXPECT_NE(reasonOfRefusal(rig, bad).find("not finite"), std::string::npos);
  bad = poses;
  std::swap(bad[20], bad[21]);
  EXPECT_NE(reasonOfRefusal(rig, bad).find("do not rise"), std::string::npos);
  bad = poses;
  for (SensorPose& pose : bad) pose.stamp += toNs(1e4);
  EXPECT_NE(reasonOfRefusal(rig, bad).find("cover"), std::string::npos);
  bad = poses;
  for (SensorPose& pose : bad) pose.T_M_S.t *= 3.0;  // not metric
  EXPECT_FALSE(reasonOfRefusal(rig, bad).empty());
  EXPECT_FALSE(alignFromPoses(ImuBuffer(), roughRotation(rig), poses, {}));
}

TEST(AlignFromPoses, AccelerometerInWrongUnitsIsNamed) {
  const SimulatedRig rig(sim::Motion::kFull, 1, 12.0, test::mountings()[0], 0.0);
  ImuBuffer in_g;
  for (ImuSample sample : rig.imu.samples()) {
    sample.accel /= 9.80665;
    in_g.push(sample);
  }
  std::string reason;
  EXPECT_FALSE(alignFromPoses(in_g, roughRotation(rig), noisyPoses(rig, 10.0, {}), {}, &reason));
  EXPECT_NE(reason.find("unit"), std::string::npos) << reason;
}

}  // namespace
}  // namespace cocalib
