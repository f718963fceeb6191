#include "cocalib/initialization/rotation_initializer.h"

#include <gtest/gtest.h>

#include "initialization/simulated_rig.h"

namespace cocalib {
namespace {

using test::SimulatedRig;
constexpr double kDegree = M_PI / 180.0;

void expectFound(const SimulatedRig& rig, const std::vector<RelativeSensorRotation>& rotations, double max_rotation_rad,
                 double max_offset_s) {
  std::string reason;
  const auto found = initializeRotation(rig.imu, rotations, {}, &reason);
  ASSERT_TRUE(found) << reason;
  EXPECT_LT(test::angleBetween(found->R_imu_sensor, rig.T_I_S.q), max_rotation_rad);
  EXPECT_NEAR(found->time_offset_s, rig.offset_s, max_offset_s);
  EXPECT_LT((found->gyro_bias - rig.bias.gyro).norm(), 0.04);
  EXPECT_LT(test::angleBetween(found->R_imu_sensor, rig.T_I_S.q), 5.0 * found->rotation_sigma_rad);
  EXPECT_LT(std::abs(found->time_offset_s - rig.offset_s), 5.0 * found->time_offset_sigma_s);
}

std::string reasonOfRefusal(const SimulatedRig& rig, const std::vector<RelativeSensorRotation>& rotations) {
  std::string reason;
  EXPECT_FALSE(initializeRotation(rig.imu, rotations, {}, &reason));
  return reason;
}

// Lidar odometry: 10 Hz, 4 mrad a pair. Any mounting, offsets of both signs, 10 s, no guess.
TEST(RotationInitializer, LidarLikeRotationsFromAnyMounting) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const double offsets[] = {0.02, -0.015, 0.1, -0.2};
    for (std::size_t m = 0; m < test::mountings().size(); ++m) {
      const SimulatedRig rig(sim::Motion::kFull, seed, 10.0, test::mountings()[m], offsets[m]);
      expectFound(rig, rig.odometryRotations(10.0, 0.0028), 0.3 * kDegree, 0.003);
    }
  }
}

// The same with errors that pile up from pair to pair: 100 pairs of 0.1 rad, each good to 4 mrad per axis, hold
// 0.004 / (0.1 sqrt(100 * 2/3)) = 0.3 deg per axis and no more.
TEST(RotationInitializer, IndependentPairsReachTheirBound) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const SimulatedRig rig(sim::Motion::kFull, seed, 10.0, test::mountings()[seed], 0.02);
    expectFound(rig, rig.rotations(10.0, 0.003, 0.005, 0.0), 0.9 * kDegree, 0.004);
  }
}

// A camera at 20 Hz whose pairs differ in quality by 20 times, a fifth of them wrong, on a gyro with a large bias.
// 240 good pairs of 0.05 rad and 11 mrad: 0.011 / (0.05 sqrt(240 * 2/3)) = 1 deg per axis.
TEST(RotationInitializer, MixedNoiseOutliersAndBias) {
  for (std::uint64_t seed = 1; seed <= 5; ++seed) {
    const SimulatedRig rig(sim::Motion::kFull, seed, 15.0, test::mountings()[seed % 4], 0.02, 0.08);
    expectFound(rig, rig.rotations(20.0, 0.001, 0.02, 0.2), 2.5 * kDegree, 0.01);
  }
}

TEST(RotationInitializer, MildMotionTakesLonger) {
  const SimulatedRig rig(sim::Motion::kMild, 1, 30.0, test::mountings()[1], 0.02);
  expectFound(rig, rig.rotations(10.0, 0.001, 0.003, 0.1), 1.0 * kDegree, 0.01);
}

TEST(RotationInitializer, ExactRotationsGiveTheExactAnswer) {
  SimulatedRig rig(sim::Motion::kFull, 2, 12.0, test::mountings()[3], -0.0137, 0.05);
  // What remains is the gyro's own noise: 1.7e-4 rad/sqrt(s) over 240 intervals of 0.05 s.
  expectFound(rig, rig.rotations(20.0, 0.0, 0.0, 0.0), 2e-4, 1e-4);
}

TEST(RotationInitializer, NamesTheMissingMotion) {
  const SimulatedRig planar(sim::Motion::kPlanar, 1, 15.0, test::mountings()[0], 0.0);
  std::string reason = reasonOfRefusal(planar, planar.rotations(10.0, 0.003, 0.005, 0.0));
  EXPECT_NE(reason.find("share one axis, imu z"), std::string::npos) << reason;
  EXPECT_NE(reason.find("rotate about a second axis"), std::string::npos) << reason;

  for (const sim::Motion motion : {sim::Motion::kStatic, sim::Motion::kTranslationOnly}) {
    const SimulatedRig rig(motion, 1, 15.0, test::mountings()[0], 0.0, 0.08);
    reason = reasonOfRefusal(rig, rig.rotations(10.0, 0.003, 0.005, 0.0));
    EXPECT_NE(reason.find("hardly turns"), std::string::npos) << reason;
  }
}

TEST(RotationInitializer, ConstantRateLeavesTheOffsetUnknown) {
  SimulatedRig rig(sim::Motion::kStatic, 1, 15.0, test::mountings()[2], 0.0);
  ImuBuffer spinning;
  for (ImuSample sample : rig.imu.samples()) {
    sample.gyro += Eigen::Vector3d(0.3, 0.5, 0.4);
    spinning.push(sample);
  }
  std::vector<RelativeSensorRotation> rotations;
  const auto stamps = rig.stamps(10.0);
  for (std::size_t i = 1; i < stamps.size(); ++i) {
    const Eigen::Vector3d angle = toSeconds(stamps[i] - stamps[i - 1]) * Eigen::Vector3d(0.3, 0.5, 0.4);
    rotations.push_back({stamps[i - 1], stamps[i], expSo3(rig.T_I_S.q.conjugate() * angle)});
  }
  std::string reason;
  EXPECT_FALSE(initializeRotation(spinning, rotations, {}, &reason));
  EXPECT_NE(reason.find("constant"), std::string::npos) << reason;
}

TEST(RotationInitializer, RefusesRotationsThatAreNotTheRigs) {
  const SimulatedRig rig(sim::Motion::kFull, 1, 15.0, test::mountings()[2], 0.0);
  const SimulatedRig other(sim::Motion::kFull, 9, 15.0, test::mountings()[2], 0.0);
  EXPECT_FALSE(reasonOfRefusal(rig, other.rotations(10.0, 0.003, 0.005, 0.0)).empty());
}

TEST(RotationInitializer, SaysWhenThereIsTooLittleOrTheClocksAreApart) {
  const SimulatedRig rig(sim::Motion::kFull, 1, 10.0, test::mountings()[0], 0.0);
  auto rotations = rig.rotations(10.0, 0.003, 0.005, 0.0);
  const std::vector<RelativeSensorRotation> few(rotations.begin() + 10, rotations.begin() + 30);
  EXPECT_NE(reasonOfRefusal(rig, few).find("keep moving"), std::string::npos);
  for (auto& pair : rotations) {
    pair.stamp_a += toNs(1000.0);
    pair.stamp_b += toNs(1000.0);
  }
  EXPECT_NE(reasonOfRefusal(rig, rotations).find("clocks"), std::string::npos);
  EXPECT_FALSE(initializeRotation(ImuBuffer(), rotations, {}, nullptr));
}

}  // namespace
}  // namespace cocalib
