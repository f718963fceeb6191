// What the fuser does when its data are interrupted or contradict each other.

#include <gtest/gtest.h>

#include <limits>
#include <random>
#include <set>

#include "cocalib/calibrators/cocalibration_fuser.h"
#include "tampered_lidar.h"

namespace cocalib {
namespace {

using test::countOf;
using test::TamperedLidar;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

FuserInputs lidarAlone() {
  FuserInputs inputs;
  inputs.lidar = true;
  return inputs;
}

/// A lidar calibrator that feeds a fuser; `tamper` sees every keyframe on its way.
struct Playback {
  template <typename Tamper>
  Playback(const TamperedLidar& recording, const Tamper& tamper)
      : calibrator(LidarInertialParams(), recording.noise(), std::nullopt),
        fuser(FuserParams(), recording.noise(), lidarAlone()) {
    std::size_t next = 0;
    for (int k = 0; k < recording.sweeps(); ++k) {
      for (; next < recording.imu().size() && recording.secondsOf(recording.imu()[next].stamp) < 0.1 * (k + 1) + 0.01;
           ++next) {
        calibrator.addImu(recording.imu()[next]);
        fuser.addImu(recording.imu()[next]);
      }
      for (LidarKeyframe& keyframe : calibrator.addScan(recording.sweep(k))) {
        tamper(&keyframe, &fuser);
        fuser.addLidar(std::move(keyframe));
      }
      fuser.setLidarEstimate(calibrator.estimate());
      while (fuser.wantsSolve() && fuser.solve()) note();
      note();
    }
  }
  explicit Playback(const TamperedLidar& recording) : Playback(recording, [](LidarKeyframe*, CoCalibrationFuser*) {}) {}

  void note() {
    const CalibrationEstimate estimate = fuser.estimate();
    words.insert(estimate.message);
    if (was_valid && !estimate.lidar.valid) ++losses;
    was_valid = estimate.lidar.valid;
    all_finite = all_finite && estimate.covariance.allFinite() && estimate.calibration.T_imu_lidar.t.allFinite();
  }
  std::uint64_t count(const std::string& what) const { return countOf(fuser.diagnostics(), what); }
  bool said(const std::string& part) const {
    return std::any_of(words.begin(), words.end(),
                       [&](const std::string& w) { return w.find(part) != std::string::npos; });
  }

  LidarInertialCalibrator calibrator;
  CoCalibrationFuser fuser;
  std::set<std::string> words;
  bool was_valid = false, all_finite = true;
  int losses = 0;  // of an estimate that there was
};

TEST(FuserFailure, KnowledgeOutlivesAnInterruption) {
  TamperedLidar recording(26.0);
  recording.loseImu(11.0, 16.0);
  Playback run(recording);
  EXPECT_EQ(run.count("restarts after interruption"), 1U);
  EXPECT_EQ(run.losses, 0);
  EXPECT_TRUE(run.said("going on with what is known"));
  const CalibrationEstimate live = run.fuser.estimate();
  // A second of sweeps comes at once, once a second they are solved for, and the last sweep is still under way.
  EXPECT_GT(live.stamp, recording.imu().back().stamp - toNs(2.2));  // it solves again
  run.fuser.finish();
  const CalibrationEstimate last = run.fuser.estimate();
  ASSERT_TRUE(last.lidar.valid);
  EXPECT_LT(recording.error_m(last), 4.0 * last.lidar.sigma.head<3>().norm());
  EXPECT_LT(recording.error_m(last), 2e-3);
}

TEST(FuserFailure, ThreeFailedSolvesInARowStartOver) {
  std::mt19937 random(1);
  std::normal_distribution<float> anywhere(0.0F, 20.0F);
  const TamperedLidar recording(28.0);
  Playback run(recording, [&](LidarKeyframe* keyframe, CoCalibrationFuser*) {
    const double t = recording.secondsOf(keyframe->scan.stamp);
    if (t < 10.0 || t >= 15.0) return;
    for (LidarPoint& point : keyframe->scan.points) {
      point.p = {anywhere(random), anywhere(random), anywhere(random)};
    }
  });
  EXPECT_GE(run.count("failed solves"), 3U);
  EXPECT_GE(run.count("restarts after failure"), 1U);
  EXPECT_TRUE(run.said("starting over: "));
  EXPECT_TRUE(run.all_finite);
  run.fuser.finish();
  ASSERT_TRUE(run.fuser.estimate().lidar.valid) << run.fuser.estimate().message;
  EXPECT_LT(recording.error_m(run.fuser.estimate()), 5e-3);
}

// Keyframes and estimates come over topics, so from anyone.
TEST(FuserFailure, WhatCannotBeIsRefusedAndChangesNothing) {
  const TamperedLidar recording(10.0);
  Playback clean(recording);
  int refused = 0;
  Playback dirty(recording, [&](LidarKeyframe* keyframe, CoCalibrationFuser* fuser) {
    LidarKeyframe broken = *keyframe;
    broken.scan.points.resize(50);
    broken.scan.points[20].p.z() = static_cast<float>(kNaN);
    fuser->addLidar(broken);
    broken = *keyframe;
    broken.scan.points.resize(50);
    ASSERT_TRUE(broken.state);
    broken.state->T_W_I.q.coeffs() *= 1.5;
    fuser->addLidar(broken);
    broken.state->T_W_I.q.setIdentity();
    broken.state->v_W.x() = kNaN;
    fuser->addLidar(broken);
    refused += 3;
    CalibrationEstimate estimate;
    estimate.lidar.valid = true;
    estimate.calibration.T_imu_lidar.t.x() = kNaN;
    EXPECT_FALSE(fuser->setLidarEstimate(estimate));
  });
  EXPECT_EQ(dirty.count("keyframes refused"), static_cast<std::uint64_t>(refused));
  EXPECT_GT(refused, 0);
  ASSERT_TRUE(clean.fuser.estimate().lidar.valid);
  EXPECT_EQ(dirty.fuser.estimate().calibration.T_imu_lidar.t, clean.fuser.estimate().calibration.T_imu_lidar.t);
  EXPECT_EQ(dirty.fuser.estimate().covariance, clean.fuser.estimate().covariance);
}

TEST(FuserFailure, KeyframesThatComeTwiceCountOnce) {
  const TamperedLidar recording(9.0);
  Playback clean(recording);
  Playback twice(recording, [](LidarKeyframe* keyframe, CoCalibrationFuser* fuser) { fuser->addLidar(*keyframe); });
  EXPECT_GT(twice.count("keyframes refused"), 50U);
  ASSERT_TRUE(clean.fuser.estimate().lidar.valid);
  EXPECT_EQ(twice.fuser.estimate().covariance, clean.fuser.estimate().covariance);
}

}  // namespace
}  // namespace cocalib
