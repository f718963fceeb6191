#include <gtest/gtest.h>

#include "cocalib/initialization/alignment.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/scene.h"
#include "initialization/simulated_rig.h"

namespace cocalib {
namespace {

using test::SimulatedRig;

/// The paper's rig with its camera turned about the optical axis, shifted, and on a clock of its own.
SimulatedRig cameraRig(sim::Motion motion, std::uint64_t seed, double duration_s, double optical_roll,
                       const Eigen::Vector3d& lever, double offset_s, double gyro_bias = 4.85e-5,
                       double accel_bias = 1.5e-4) {
  sim::Scenario scenario;
  scenario.camera.optical_roll = optical_roll;
  scenario.camera.translation = lever;
  SimulatedRig rig(motion, seed, duration_s, scenario.camera.T_imu_camera(), offset_s, gyro_bias, accel_bias);
  rig.scenario.camera.optical_roll = optical_roll;
  rig.scenario.camera.translation = lever;
  rig.scenario.camera.time_offset_s = offset_s;
  rig.scenario.camera.rate_hz = 20.0;
  return rig;
}

std::vector<BearingFrame> bearingFrames(const SimulatedRig& rig, double noise_px, double outlier_share) {
  sim::Scenario scenario = rig.scenario;
  scenario.camera.track_noise_px = noise_px;
  const sim::Scene scene(scenario);
  sim::TrackSimulator simulator(scenario, scene, *rig.trajectory);
  const CameraModel camera = scenario.camera.cameraModel();
  std::vector<BearingFrame> frames;
  for (int k = 0; k < sim::imageCount(scenario); ++k) {
    const auto observations = simulator.observe(k);
    const double t = sim::imageTime(scenario, k);
    if (t < rig.start_s || t > rig.end_s) continue;
    BearingFrame frame;
    frame.stamp = sim::imageStamp(scenario, k);
    for (const TrackObservation& observation : observations) {
      Eigen::Vector2d px = observation.px.cast<double>();
      sim::Random random(scenario.seed, sim::Random::Stream::kTracks, 1000 + observation.id);
      // A wrong track slides over the picture by tens of pixels a second.
      if (random.uniform() < outlier_share) px += 40.0 * t * random.normal3().head<2>();
      const auto bearing = camera.unproject(px);
      if (!bearing) continue;
      frame.ids.push_back(observation.id);
      frame.bearings_C.push_back(*bearing);
    }
    frames.push_back(frame);
  }
  return frames;
}

RotationInitialization roughRotation(const SimulatedRig& rig, double scale = 1.0) {
  sim::Random random(rig.scenario.seed, sim::Random::Stream::kTracks, 6);
  RotationInitialization rotation;
  rotation.R_imu_sensor = expSo3(scale * 0.006 * random.normal3()) * rig.T_I_S.q;
  rotation.gyro_bias = rig.bias.gyro + scale * 0.004 * random.normal3();
  rotation.time_offset_s = rig.offset_s + scale * 0.002 * random.normal();
  return rotation;
}

struct Limits {
  double lever_m, velocity, tilt, rotation_rad, offset_s;
};

void expectAligned(const SimulatedRig& rig, const Alignment& found, const Limits& limits) {
  const Eigen::Vector3d lever_error = found.T_imu_sensor.t - rig.T_I_S.t;
  EXPECT_LT(lever_error.norm(), limits.lever_m);
  // Formal sigmas: the gyro's own noise, which the attitude of a whole chunk inherits, is not in them.
  EXPECT_LT(lever_error.norm(), 6.0 * found.lever_arm_sigma_m.norm());
  EXPECT_LT(test::angleBetween(found.T_imu_sensor.q, rig.T_I_S.q), limits.rotation_rad);
  EXPECT_NEAR(found.time_offset_s, rig.offset_s, limits.offset_s);
  EXPECT_LT((found.gyro_bias - rig.bias.gyro).norm(), 0.004);
  for (const NavState& state : found.states) {
    const NavState truth = rig.trajectory->stateAt(state.stamp);
    // The worlds differ by heading and origin: compare what a rider of the IMU sees.
    EXPECT_LT((state.T_W_I.q.conjugate() * state.v_W - truth.T_W_I.q.conjugate() * truth.v_W).norm(), limits.velocity);
    const Eigen::Vector3d up = state.T_W_I.q.conjugate() * Eigen::Vector3d::UnitZ();
    EXPECT_LT((up - truth.T_W_I.q.conjugate() * Eigen::Vector3d::UnitZ()).norm(), limits.tilt);
  }
}

std::string reasonOfRefusal(const SimulatedRig& rig, const std::vector<BearingFrame>& frames) {
  std::string reason;
  EXPECT_FALSE(alignFromTracks(rig.imu, roughRotation(rig), frames, {}, &reason));
  return reason;
}

// No metric pose anywhere: 0.7 px tracks, rotation wrong by 0.6 deg, gyro bias by 7 mrad/s, clock by 2 ms.
TEST(AlignFromTracks, FullMotion) {
  const SimulatedRig rig = cameraRig(sim::Motion::kFull, 1, 10.0, 0.0, {0.1, 0.0, 0.0}, 0.02);
  const auto frames = bearingFrames(rig, 0.7, 0.0);
  std::string reason;
  const auto found = alignFromTracks(rig.imu, roughRotation(rig), frames, {}, &reason);
  ASSERT_TRUE(found) << reason;
  ASSERT_EQ(found->states.size(), frames.size());
  EXPECT_EQ(found->states[3].stamp, frames[3].stamp + toNs(found->time_offset_s));
  expectAligned(rig, *found, {0.03, 0.12, 0.01, 0.006, 0.001});
}

TEST(AlignFromTracks, UpsideDownHalfAMetreAwayWithOutliersAndLargeBiases) {
  const SimulatedRig rig = cameraRig(sim::Motion::kFull, 2, 12.0, M_PI, {-0.3, 0.4, 0.1}, -0.015, 0.08, 0.1);
  std::string reason;
  const auto found = alignFromTracks(rig.imu, roughRotation(rig), bearingFrames(rig, 0.7, 0.15), {}, &reason);
  ASSERT_TRUE(found) << reason;
  expectAligned(rig, *found, {0.04, 0.15, 0.015, 0.008, 0.001});
}

// Camera rotations alone leave degrees and tens of mrad/s: rotation 2.9 deg, bias 31 mrad/s wrong here.
TEST(AlignFromTracks, FromAPoorRotation) {
  const SimulatedRig rig = cameraRig(sim::Motion::kFull, 1, 12.0, 0.3, {-0.02, -0.06, 0.01}, 0.0, 0.08, 0.1);
  std::string reason;
  const auto found = alignFromTracks(rig.imu, roughRotation(rig, 4.0), bearingFrames(rig, 0.7, 0.1), {}, &reason);
  ASSERT_TRUE(found) << reason;
  expectAligned(rig, *found, {0.04, 0.15, 0.015, 0.008, 0.001});
}

TEST(AlignFromTracks, MildMotion) {
  const SimulatedRig rig = cameraRig(sim::Motion::kMild, 1, 12.0, M_PI / 2, {0.0, 0.1, 0.2}, 0.0);
  std::string reason;
  const auto found = alignFromTracks(rig.imu, roughRotation(rig), bearingFrames(rig, 0.5, 0.0), {}, &reason);
  ASSERT_TRUE(found) << reason;
  expectAligned(rig, *found, {0.15, 0.15, 0.02, 0.02, 0.006});
}

TEST(AlignFromTracks, RefusesMotionWithoutParallax) {
  for (const sim::Motion motion : {sim::Motion::kStatic, sim::Motion::kRotationOnly}) {
    const SimulatedRig rig = cameraRig(motion, 1, 10.0, 0.0, {0.02, 0.0, 0.0}, 0.0);
    const std::string reason = reasonOfRefusal(rig, bearingFrames(rig, 0.5, 0.0));
    EXPECT_NE(reason.find("shift the camera"), std::string::npos) << reason;
  }
}

TEST(AlignFromTracks, SaysWhatIsWrongWithTheInput) {
  const SimulatedRig rig = cameraRig(sim::Motion::kFull, 1, 6.0, 0.0, {0.1, 0.0, 0.0}, 0.0);
  auto frames = bearingFrames(rig, 0.5, 0.0);
  EXPECT_NE(reasonOfRefusal(rig, {frames.begin(), frames.begin() + 20}).find("keep moving"), std::string::npos);
  std::vector<BearingFrame> bad = frames;
  std::swap(bad[10], bad[11]);
  EXPECT_NE(reasonOfRefusal(rig, bad).find("do not rise"), std::string::npos);
  for (BearingFrame& frame : frames) frame.stamp += toNs(1e4);
  EXPECT_NE(reasonOfRefusal(rig, frames).find("cover"), std::string::npos);
}

}  // namespace
}  // namespace cocalib
