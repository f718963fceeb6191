// What the visual-inertial calibrator does when its pictures are lost or lie.

#include <gtest/gtest.h>

#include <algorithm>
#include <functional>
#include <limits>
#include <random>
#include <set>
#include <string>

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
  /// @param tamper_imu  changes the sample of so many seconds, or says with false that it is lost; may be empty
  explicit MeasuredRun(const sim::Scenario& s, const std::function<bool(double, ImuSample*)>& tamper_imu = {})
      : scenario_(s),
        scene_(s),
        trajectory_(s),
        tracks_(s, scene_, trajectory_),
        calibrator_(VisualInertialParams(), {s.imu.gyro_noise_density, 1e-6, s.imu.accel_noise_density, 1e-5},
                    s.camera.cameraModel(), std::nullopt, std::nullopt) {
    for (ImuSample sample : sim::simulateImu(s, trajectory_)) {
      if (tamper_imu && !tamper_imu(toSeconds(sample.stamp - s.epoch), &sample)) continue;
      calibrator_.addImu(sample);
    }
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
      words_.insert(calibrator_.diagnostics().message);
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
  bool said(const std::string& part) const {
    return std::any_of(words_.begin(), words_.end(),
                       [&](const std::string& words) { return words.find(part) != std::string::npos; });
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
  std::set<std::string> words_;  // all that it said
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

TEST(VisualInertialFailure, ThreeFailedSolvesInARowStartOver) {
  std::mt19937 random(1);
  std::normal_distribution<double> rate(0.0, 20.0);
  MeasuredRun run(recording(26.0), [&](double t, ImuSample* sample) {
    if (t >= 8.0 && t < 13.0) sample->gyro += Eigen::Vector3d(rate(random), rate(random), rate(random));
    return true;
  });
  run.feed(0.0, 8.0);
  ASSERT_TRUE(run.calibrator().estimate().camera.valid);
  run.feed(8.0, 26.0);
  EXPECT_GE(run.count("failed solves"), 3U);
  EXPECT_GE(run.count("restarts after failure"), 1U);
  EXPECT_TRUE(run.said("starting over: the pictures contradict the inertial data"));
  ASSERT_TRUE(run.calibrator().estimate().camera.valid) << run.calibrator().estimate().message;
  EXPECT_LT(run.error_m(), 5e-3);
}

TEST(VisualInertialFailure, FiveSecondsWithoutInertialDataStartOver) {
  MeasuredRun run(recording(24.0), [](double t, ImuSample*) { return t < 8.0 || t >= 13.0; });
  run.feed(0.0, 24.0);
  EXPECT_EQ(run.count("restarts after failure"), 1U);
  EXPECT_TRUE(run.said("starting over: no inertial data for 5.0 s"));
  ASSERT_TRUE(run.calibrator().estimate().camera.valid) << run.calibrator().estimate().message;
  EXPECT_LT(run.error_m(), 5e-3);
}

TEST(VisualInertialFailure, HalfASecondWithoutInertialDataStartsOverFromThePicturesAfterIt) {
  MeasuredRun run(recording(20.0), [](double t, ImuSample*) { return t < 8.0 || t >= 8.5; });
  run.feed(0.0, 20.0);
  EXPECT_EQ(run.count("restarts after failure"), 1U);
  EXPECT_EQ(run.count("failed solves"), 0U);
  ASSERT_TRUE(run.calibrator().estimate().camera.valid) << run.calibrator().estimate().message;
  EXPECT_LT(run.error_m(), 5e-3);
}

TEST(VisualInertialFailure, SaysWhyItStartedOverUntilTheCameraIsFoundAgain) {
  MeasuredRun run(recording(18.0), [](double t, ImuSample*) { return t < 8.0 || t >= 8.5; });
  run.feed(0.0, 9.0);
  run.feed(9.0, 12.5, [](VisualKeyframe* frame) { frame->tracks.clear(); });  // nothing to start from
  const std::string words = run.calibrator().diagnostics().message;
  EXPECT_EQ(words.find("starting over: no inertial data for 0.5 s; "), 0U) << words;
  run.feed(12.5, 18.0);
  EXPECT_TRUE(run.calibrator().estimate().camera.valid);
  EXPECT_EQ(run.calibrator().diagnostics().message.find("starting over"), std::string::npos);
}

TEST(VisualInertialFailure, StartsFromThePicturesThatInertialDataCover) {
  for (const double imu_from_s : {4.0, 4.02, 4.03}) {
    MeasuredRun run(recording(16.0), [&](double t, ImuSample*) { return t >= imu_from_s; });
    run.feed(0.0, 16.0);
    EXPECT_EQ(run.count("failed solves"), 0U) << imu_from_s;
    ASSERT_TRUE(run.calibrator().estimate().camera.valid) << run.calibrator().estimate().message;
    EXPECT_LT(run.error_m(), 5e-3) << imu_from_s;
  }
}

TEST(VisualInertialFailure, OnePictureOfAnotherTimeOrWithoutNumbersCostsNothing) {
  MeasuredRun clean(recording(8.0)), dirty(recording(8.0));
  clean.feed(0.0, 8.0);
  int picture = 0;
  dirty.feed(0.0, 8.0, [&](VisualKeyframe* frame) {
    if (++picture % 10 != 0) return;
    if (picture % 20 == 0) frame->stamp += toNs(picture % 40 == 0 ? 3600.0 : -3600.0);
    if (picture % 20 != 0 && !frame->tracks.empty()) frame->tracks[0].px.x() = std::numeric_limits<float>::quiet_NaN();
  });
  EXPECT_EQ(dirty.count("images out of order"), 10U);
  EXPECT_EQ(dirty.count("images with impossible numbers"), 10U);
  EXPECT_EQ(dirty.count("restarts after failure"), 0U);
  ASSERT_TRUE(clean.calibrator().estimate().camera.valid && dirty.calibrator().estimate().camera.valid);
  EXPECT_LT(dirty.error_m(), 2.0 * clean.error_m() + 1e-3);
}

}  // namespace
}  // namespace cocalib
