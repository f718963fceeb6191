// What the lidar-inertial calibrator does when its data are lost or lie.

#include <gtest/gtest.h>

#include <algorithm>
#include <limits>
#include <set>

#include "tampered_lidar.h"

namespace cocalib {
namespace {

using test::countOf;
using test::TamperedLidar;

constexpr double kNaN = std::numeric_limits<double>::quiet_NaN();

/// One calibrator with a recording.
struct Playback {
  explicit Playback(const TamperedLidar& r)
      : recording(r), calibrator(LidarInertialParams(), r.noise(), std::nullopt) {}

  /// Plays [from, to) seconds; `tamper` sees every sweep before the calibrator does.
  template <typename Tamper>
  void feed(double from, double to, const Tamper& tamper) {
    const std::vector<ImuSample>& imu = recording.imu();
    for (int k = static_cast<int>(10.0 * from); k < std::min(recording.sweeps(), static_cast<int>(10.0 * to)); ++k) {
      for (; next < imu.size() && recording.secondsOf(imu[next].stamp) < 0.1 * (k + 1) + 0.01; ++next) {
        calibrator.addImu(imu[next]);
      }
      LidarScan sweep = recording.sweep(k);
      tamper(&sweep);
      calibrator.addScan(sweep);
      words.insert(calibrator.diagnostics().message);
    }
  }
  void feed(double from, double to) {
    feed(from, to, [](LidarScan*) {});
  }
  std::uint64_t count(const std::string& what) const { return countOf(calibrator.diagnostics(), what); }
  bool said(const std::string& part) const {
    return std::any_of(words.begin(), words.end(),
                       [&](const std::string& w) { return w.find(part) != std::string::npos; });
  }
  double error_m() const { return recording.error_m(calibrator.estimate()); }

  const TamperedLidar& recording;
  LidarInertialCalibrator calibrator;
  std::size_t next = 0;
  std::set<std::string> words;
};

TEST(LidarInertialFailure, ThreeFailedSolvesInARowStartOver) {
  TamperedLidar recording(24.0);
  recording.breakImu(8.0, 13.0);
  Playback run(recording);
  run.feed(0.0, 8.0);
  ASSERT_TRUE(run.calibrator.estimate().lidar.valid);
  run.feed(8.0, 24.0);
  EXPECT_GE(run.count("failed solves"), 3U);
  EXPECT_EQ(run.count("restarts after failure"), 1U);
  EXPECT_TRUE(run.said("starting over: the sweeps contradict the inertial data"));
  ASSERT_TRUE(run.calibrator.estimate().lidar.valid) << run.calibrator.estimate().message;
  EXPECT_LT(run.error_m(), 5e-3);
}

TEST(LidarInertialFailure, FiveSecondsWithoutInertialDataStartOver) {
  TamperedLidar recording(22.0);
  recording.loseImu(8.0, 13.0);
  Playback run(recording);
  run.feed(0.0, 22.0);
  EXPECT_EQ(run.count("restarts after failure"), 1U);
  EXPECT_TRUE(run.said("starting over: no inertial data for 5.0 s"));
  ASSERT_TRUE(run.calibrator.estimate().lidar.valid) << run.calibrator.estimate().message;
  EXPECT_LT(run.error_m(), 5e-3);
}

TEST(LidarInertialFailure, AShortInertialGapIsBridgedHonestly) {
  for (const double gap_s : {0.05, 0.2}) {
    TamperedLidar recording(12.0);
    recording.loseImu(8.0, 8.0 + gap_s);
    Playback run(recording);
    run.feed(0.0, 12.0);
    EXPECT_EQ(run.count("restarts after failure"), 0U) << gap_s;
    const CalibrationEstimate estimate = run.calibrator.estimate();
    ASSERT_TRUE(estimate.lidar.valid);
    EXPECT_LT(run.error_m(), 4.0 * estimate.lidar.sigma.head<3>().norm()) << gap_s;
    EXPECT_LT(run.error_m(), 3e-3) << gap_s;
  }
}

TEST(LidarInertialFailure, ALidarThatComesBackStartsOver) {
  const TamperedLidar recording(24.0);
  Playback run(recording);
  run.feed(0.0, 7.0);
  ASSERT_TRUE(run.calibrator.estimate().lidar.valid);
  run.feed(14.0, 24.0);
  EXPECT_EQ(run.count("restarts after failure"), 1U);
  EXPECT_TRUE(run.said("starting over: no sweeps for longer than the window"));
  ASSERT_TRUE(run.calibrator.estimate().lidar.valid);
  EXPECT_LT(run.error_m(), 5e-3);
}

// Repeated sweeps must not count twice, broken ones not at all: everything is as if they had not come.
TEST(LidarInertialFailure, RepeatedAndImpossibleSweepsChangeNothing) {
  const TamperedLidar recording(8.0);
  Playback clean(recording), dirty(recording);
  clean.feed(0.0, 8.0);
  bool first = true;
  dirty.feed(0.0, 8.0, [&](LidarScan* sweep) {
    LidarScan broken = *sweep;
    broken.points[broken.points.size() / 2].p.y() = static_cast<float>(kNaN);
    broken.points.resize(broken.points.size() / 2 + 1);
    dirty.calibrator.addScan(broken);
    broken = *sweep;
    broken.points[7].p.x() = 1e30F;
    for (std::size_t i = 0; i < 8; ++i) broken.points[i].offset_s = 0.0F;
    broken.points.resize(8);
    dirty.calibrator.addScan(broken);
    broken = *sweep;
    broken.stamp += toNs(3600.0);
    if (!first) dirty.calibrator.addScan(broken);
    first = false;
    dirty.calibrator.addScan(*sweep);
  });
  EXPECT_EQ(dirty.count("scans with impossible numbers"), 2U * 80U);
  EXPECT_EQ(dirty.count("scans out of order"), 2U * 80U - 1U);
  EXPECT_EQ(dirty.count("restarts after failure"), 0U);
  ASSERT_TRUE(clean.calibrator.estimate().lidar.valid);
  EXPECT_EQ(dirty.calibrator.estimate().calibration.T_imu_lidar.t,
            clean.calibrator.estimate().calibration.T_imu_lidar.t);
  EXPECT_EQ(dirty.calibrator.estimate().covariance, clean.calibrator.estimate().covariance);
}

TEST(LidarInertialFailure, NoNumberThatIsNotFiniteReachesAnEstimate) {
  TamperedLidar recording(10.0);
  std::vector<ImuSample>& imu = recording.imu();
  for (std::size_t i = 100; i < imu.size(); i += 100) {
    const double bad = i % 200 == 0 ? kNaN : 1e300;
    (i % 300 == 0 ? imu[i].gyro : imu[i].accel)[static_cast<int>(i / 100 % 3)] = bad;
  }
  Playback run(recording);
  run.feed(0.0, 10.0, [&](LidarScan*) {
    Calibration feedback = run.calibrator.estimate().calibration;
    feedback.T_imu_lidar.q.coeffs() *= 2.0;
    run.calibrator.setJointCalibration(feedback);
    feedback.T_imu_lidar.q.coeffs().setConstant(kNaN);
    run.calibrator.setJointCalibration(feedback);
    feedback = run.calibrator.estimate().calibration;
    feedback.lidar_time_offset_s = kNaN;
    run.calibrator.setJointCalibration(feedback);
  });
  EXPECT_GE(run.count("imu samples refused"), 39U);  // one in a hundred of 10 s at 400 Hz
  EXPECT_GT(run.count("feedback refused"), 0U);
  const CalibrationEstimate estimate = run.calibrator.estimate();
  ASSERT_TRUE(estimate.lidar.valid);
  EXPECT_TRUE(estimate.covariance.allFinite());
  EXPECT_NEAR(estimate.calibration.T_imu_lidar.q.norm(), 1.0, 1e-12);
  EXPECT_LT(run.error_m(), 3e-3);
}

}  // namespace
}  // namespace cocalib
