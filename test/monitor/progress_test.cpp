#include "cocalib/monitor/progress.h"

#include <gtest/gtest.h>

namespace cocalib {
namespace {

const ObservabilityThresholds kThresholds;

/// Both sensors known, every parameter to `part` of its threshold.
CalibrationEstimate known(double part, double duration_s = 20.0) {
  CalibrationEstimate estimate;
  estimate.duration_s = duration_s;
  Vector14d sigma;
  sigma << Eigen::Vector3d::Constant(kThresholds.converged_translation_m),
      Eigen::Vector3d::Constant(kThresholds.converged_rotation_rad),
      Eigen::Vector3d::Constant(kThresholds.converged_translation_m),
      Eigen::Vector3d::Constant(kThresholds.converged_rotation_rad), kThresholds.converged_time_offset_s,
      kThresholds.converged_time_offset_s;
  estimate.covariance = (part * sigma).cwiseAbs2().asDiagonal();
  judgeEstimate(true, true, kThresholds, &estimate);
  return estimate;
}

TEST(MotionHint, NamesTheMissingRotationOfAPlanarDrive) {
  // Turning about z only leaves the lever arm's z open; x has been turned about least.
  CalibrationEstimate planar = known(0.5);
  planar.covariance(8, 8) = 0.3 * 0.3;
  const auto hint = adviseMotion(planar, {0.1, 0.4, 30.0}, kThresholds);
  ASSERT_TRUE(hint);
  EXPECT_EQ(hint->axis_I, Eigen::Vector3d::UnitX());
  EXPECT_NE(hint->words.find("turn about imu x"), std::string::npos) << hint->words;
  EXPECT_NE(hint->words.find("lidar translation along imu z does not show yet"), std::string::npos) << hint->words;
  // Once it has turned about x more than about y, y is what helps; a little more does not count.
  EXPECT_EQ(adviseMotion(planar, {2.0, 0.4, 30.0}, kThresholds)->axis_I, Eigen::Vector3d::UnitY());
  EXPECT_EQ(adviseMotion(planar, {2.0, 1.9, 30.0}, kThresholds)->axis_I, Eigen::Vector3d::UnitX());
  planar.covariance(8, 8) = 0.02 * 0.02;
  EXPECT_NE(adviseMotion(planar, {0.1, 0.4, 30.0}, kThresholds)->words.find("imu z is known to 20.0 mm"),
            std::string::npos);
}

TEST(MotionHint, NamesTheRotationAcrossAnUnknownAngle) {
  CalibrationEstimate estimate = known(0.5);
  estimate.covariance(4, 4) = 0.02 * 0.02;
  const auto hint = adviseMotion(estimate, {9.0, 1.0, 5.0}, kThresholds);
  ASSERT_TRUE(hint);
  EXPECT_EQ(hint->axis_I, Eigen::Vector3d::UnitZ());
  EXPECT_NE(hint->words.find("camera rotation about imu y"), std::string::npos) << hint->words;
}

TEST(MotionHint, DisappearsWhenNothingIsMissing) {
  EXPECT_FALSE(adviseMotion(known(0.9), {1.0, 1.0, 1.0}, kThresholds));
  EXPECT_TRUE(adviseMotion(known(1.1), {1.0, 1.0, 1.0}, kThresholds));
}

TEST(MotionHint, LooksAtTheTurningWhileNothingIsKnown) {
  const auto hint = adviseMotion(CalibrationEstimate(), {1.0, 0.2, 3.0}, kThresholds);
  ASSERT_TRUE(hint);
  EXPECT_EQ(hint->axis_I, Eigen::Vector3d::UnitY());
}

TEST(ProgressForecast, CountsDownWithTheInformation) {
  // Sigma falls with the root of time: 4 thresholds after 10 s, 1 after 160 s.
  ProgressForecast forecast(kThresholds);
  EXPECT_FALSE(forecast.secondsLeft());
  for (const double t : {10.0, 15.0, 20.0, 25.0, 30.0, 40.0}) {
    forecast.add(known(4.0 * std::sqrt(10.0 / t), t));
  }
  ASSERT_TRUE(forecast.secondsLeft());
  EXPECT_NEAR(*forecast.secondsLeft(), 120.0, 1e-6);
  forecast.add(known(0.99, 170.0));
  EXPECT_EQ(*forecast.secondsLeft(), 0.0);
}

TEST(ProgressForecast, PromisesNothingWithoutProgress) {
  ProgressForecast forecast(kThresholds);
  forecast.add(known(4.0, 10.0));
  forecast.add(known(4.0, 20.0));
  EXPECT_FALSE(forecast.secondsLeft());
  forecast.clear();
  CalibrationEstimate still_planar = known(0.5, 10.0);
  still_planar.covariance(2, 2) = 1.0;
  forecast.add(still_planar);
  still_planar.duration_s = 20.0;
  still_planar.covariance(2, 2) = 0.99;
  forecast.add(still_planar);
  EXPECT_FALSE(forecast.secondsLeft());  // days
}

TEST(NextStep, IsTheMissingMotionThenPatienceThenTheEnd) {
  CalibrationEstimate estimate = known(2.0);
  const auto hint = adviseMotion(estimate, {5.0, 1.0, 7.0}, kThresholds);
  EXPECT_EQ(nextStep(estimate, "converging", hint), hint->words);
  estimate = known(0.5);
  estimate.status = Status::kConverging;  // two halves of the data still differ
  EXPECT_EQ(nextStep(estimate, "converging", std::nullopt), "keep moving like this");
  estimate.status = Status::kConverged;
  EXPECT_NE(nextStep(estimate, "converged", std::nullopt).find("save"), std::string::npos);
  EXPECT_EQ(nextStep(estimate, "frozen", std::nullopt), "");
}

TEST(ProgressWords, SayStateAndNeed) {
  CalibrationEstimate estimate = known(2.0);
  const std::string words =
      progressWords(estimate, "refining", kThresholds, 12.3, adviseMotion(estimate, {5.0, 1.0, 7.0}, kThresholds));
  for (const char* part :
       {"20 s, refining", "camera +- 6.0 6.0 6.0 mm (3.0)", "1.00 ms (0.50)", "turn about imu", "about 13 s more"}) {
    EXPECT_NE(words.find(part), std::string::npos) << part << " in " << words;
  }
  CalibrationEstimate nothing;
  nothing.message = "waiting for inertial data";
  EXPECT_EQ(progressWords(nothing, "waiting", kThresholds, std::nullopt, std::nullopt),
            "0 s, waiting for inertial data");
  EXPECT_EQ(progressWords(nothing, "starting", kThresholds, std::nullopt, std::nullopt),
            "0 s, starting: waiting for inertial data");
}

}  // namespace
}  // namespace cocalib
