// What the visual-inertial calibrator does when its pictures are lost or lie.

#include <gtest/gtest.h>

#include "cocalib/calibrators/visual_inertial_calibrator.h"
#include "cocalib/sim/camera.h"
#include "cocalib/sim/imu.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"

namespace cocalib {
namespace {

/// A calibrator fed with simulated measurements at 25 Hz, which a test may tamper with.
class MeasuredRun {
 public:
  explicit MeasuredRun(const sim::Scenario& s)
      : scenario_(s),
        scene_(s),
        trajectory_(s),
        tracks_(s, scene_, trajectory_),
        calibrator_(VisualInertialParams(), {s.imu.gyro_noise_density, 1e-6, s.imu.accel_noise_density, 1e-5},
                    s.camera.cameraModel(), std::nullopt, std::nullopt) {
    for (const ImuSample& sample : sim::simulateImu(s, trajectory_)) calibrator_.addImu(sample);
  }

  /// Pictures of [from, to) seconds, changed by `tamper` before the calibrator sees them.
  template <typename Tamper>
  void feed(double from, double to, const Tamper& tamper) {
    const auto first = static_cast<int>(from * scenario_.camera.rate_hz);
    const auto end = std::min(static_cast<int>(to * scenario_.camera.rate_hz), sim::imageCount(scenario_));
    for (int k = first; k < end; k += 2) {
      VisualKeyframe frame;
      frame.stamp = sim::imageStamp(scenario_, k);
      frame.tracks = tracks_.observe(k);
      tamper(&frame);
      calibrator_.addMeasurements(frame);
    }
  }
  void feed(double from, double to) {
    feed(from, to, [](VisualKeyframe*) {});
  }

  std::uint64_t count(const std::string& what) const {
    const auto counts = calibrator_.diagnostics().counts;
    const auto found = counts.find(what);
    return found == counts.end() ? 0 : found->second;
  }
  double error_m() const {
    return (calibrator_.estimate().calibration.T_imu_camera.t - scenario_.camera.T_imu_camera().t).norm();
  }
  const VisualInertialCalibrator& calibrator() const { return calibrator_; }

 private:
  sim::Scenario scenario_;
  sim::Scene scene_;
  sim::Trajectory trajectory_;
  sim::TrackSimulator tracks_;
  VisualInertialCalibrator calibrator_;
};

sim::Scenario recording(double duration_s) {
  sim::Scenario s;
  s.duration_s = duration_s;
  s.camera.track_noise_px = 0.2;
  return s;
}

TEST(VisualInertialFailure, ThreeSecondsWithoutFeaturesCostNothing) {
  MeasuredRun run(recording(16.0));
  run.feed(0.0, 8.0);
  ASSERT_TRUE(run.calibrator().estimate().camera.valid);
  run.feed(8.0, 11.0, [](VisualKeyframe* frame) { frame->tracks.clear(); });
  EXPECT_NE(run.calibrator().diagnostics().message.find("too few features"), std::string::npos)
      << run.calibrator().diagnostics().message;
  run.feed(11.0, 16.0);
  EXPECT_EQ(run.calibrator().diagnostics().message.find("too few features"), std::string::npos);
  EXPECT_EQ(run.count("restarts after failure"), 0U);
  EXPECT_LT(run.error_m(), 2e-3);
}

TEST(VisualInertialFailure, StartsOverAfterALongGapAndFindsTheCameraAgain) {
  MeasuredRun run(recording(24.0));
  run.feed(0.0, 6.0);
  ASSERT_TRUE(run.calibrator().estimate().camera.valid);
  run.feed(14.0, 14.1);
  EXPECT_EQ(run.count("restarts after failure"), 1U);
  EXPECT_FALSE(run.calibrator().estimate().camera.valid);
  EXPECT_NE(run.calibrator().estimate().message.find("no pictures"), std::string::npos);
  run.feed(14.1, 24.0);
  EXPECT_TRUE(run.calibrator().estimate().camera.valid);
  EXPECT_LT(run.error_m(), 5e-3);
}

}  // namespace
}  // namespace cocalib
