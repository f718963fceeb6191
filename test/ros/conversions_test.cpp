#include "cocalib/ros/conversions.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "cocalib/ros/estimate_conversions.h"
#include "cocalib/ros/keyframe_conversions.h"

namespace cocalib {
namespace {

const Pose kPose{expSo3({0.4, -1.1, 2.3}), {3.0, -2.0, 0.5}};

NavState someState() {
  NavState state;
  state.stamp = 1'700'000'012'345'678'901;
  state.T_W_I = kPose;
  state.v_W = {0.1, 0.2, 0.3};
  state.gyro_bias = {1e-3, 2e-3, -3e-3};
  state.accel_bias = {0.01, -0.02, 0.03};
  return state;
}

void expectSame(const NavState& a, const NavState& b) {
  EXPECT_EQ(a.stamp, b.stamp);
  EXPECT_EQ(a.T_W_I.t, b.T_W_I.t);
  EXPECT_EQ(a.T_W_I.q.coeffs(), b.T_W_I.q.coeffs());
  EXPECT_EQ(a.v_W, b.v_W);
  EXPECT_EQ(a.gyro_bias, b.gyro_bias);
  EXPECT_EQ(a.accel_bias, b.accel_bias);
}

TEST(Conversions, StampsKeepEveryNanosecond) {
  for (const TimeNs stamp : {TimeNs{0}, TimeNs{999'999'999}, TimeNs{1'700'000'000'000'000'001}}) {
    EXPECT_EQ(toTimeNs(toRosTime(stamp)), stamp);
  }
  EXPECT_EQ(toTimeNs(toRosTime(-5)), 0);
}

TEST(Conversions, BrokenQuaternionIsNoRotation) {
  geometry_msgs::Pose msg;  // all zero
  EXPECT_EQ(fromPoseMsg(msg).q.coeffs(), Eigen::Quaterniond::Identity().coeffs());
  msg.orientation.z = 2.0;
  EXPECT_NEAR(fromPoseMsg(msg).q.z(), 1.0, 1e-15);
}

TEST(Conversions, VisualKeyframeRoundTrip) {
  VisualKeyframe keyframe;
  keyframe.stamp = 1'700'000'000'123'456'789;
  keyframe.tracks = {{7, {1.25F, 2.5F}}, {4'000'000'000U, {-3.75F, 751.1F}}};
  keyframe.board.emplace();
  keyframe.board->corners_px = {{1.0F, 2.0F}, {3.0F, 4.0F}, {5.0F, 6.0F}};
  keyframe.state = someState();
  const VisualKeyframeMsg msg = toKeyframeMsg(keyframe, "cam");
  EXPECT_EQ(msg.header.frame_id, "cam");
  const VisualKeyframe back = fromKeyframeMsg(msg);
  EXPECT_EQ(back.stamp, keyframe.stamp);
  ASSERT_EQ(back.tracks.size(), 2U);
  EXPECT_EQ(back.tracks[1].id, 4'000'000'000U);
  EXPECT_EQ(back.tracks[1].px, keyframe.tracks[1].px);
  ASSERT_TRUE(back.board.has_value());
  EXPECT_EQ(back.board->corners_px, keyframe.board->corners_px);
  ASSERT_TRUE(back.state.has_value());
  expectSame(*back.state, *keyframe.state);

  const VisualKeyframe empty = fromKeyframeMsg(toKeyframeMsg(VisualKeyframe{}, "cam"));
  EXPECT_FALSE(empty.board.has_value());
  EXPECT_FALSE(empty.state.has_value());
}

TEST(Conversions, LidarKeyframeRoundTripAndDamagedSizes) {
  LidarKeyframe keyframe;
  keyframe.scan.stamp = 1'700'000'000'000'000'123;
  keyframe.scan.points = {{{1.0F, 2.0F, 3.0F}, 0.0F, 15}, {{-4.0F, 5.5F, -6.25F}, 0.0995F, -1}};
  keyframe.state = someState();
  LidarKeyframeMsg msg = toKeyframeMsg(keyframe, "lidar");
  const LidarKeyframe back = fromKeyframeMsg(msg);
  EXPECT_EQ(back.scan.stamp, keyframe.scan.stamp);
  ASSERT_EQ(back.scan.points.size(), 2U);
  EXPECT_EQ(back.scan.points[1].p, keyframe.scan.points[1].p);
  EXPECT_EQ(back.scan.points[1].offset_s, 0.0995F);
  EXPECT_EQ(back.scan.points[0].ring, 15);
  EXPECT_EQ(back.scan.points[1].ring, -1);
  ASSERT_TRUE(back.state.has_value());
  expectSame(*back.state, *keyframe.state);

  msg.ring.pop_back();
  EXPECT_EQ(fromKeyframeMsg(msg).scan.points.size(), 1U);
}

/// An estimate in which every number differs from every other.
CalibrationEstimate someEstimate() {
  CalibrationEstimate estimate;
  estimate.status = Status::kConverging;
  estimate.stamp = 1'700'000'060'000'000'001;
  estimate.duration_s = 59.5;
  estimate.calibration = {kPose, {expSo3({-0.1, 0.2, 3.0}), {0.1, 0.0, -0.08}}, 0.02, -0.015};
  const Matrix14d root = Matrix14d::NullaryExpr(
      [](Eigen::Index row, Eigen::Index col) { return std::sin(1.0 + static_cast<double>(14 * row + col)); });
  estimate.covariance = 1e-6 * root * root.transpose();
  estimate.covariance = 0.5 * (estimate.covariance + estimate.covariance.transpose().eval());
  estimate.camera.valid = estimate.lidar.valid = estimate.lidar_camera.valid = true;
  estimate.camera.sigma = Vector6d::LinSpaced(1.0, 6.0);
  estimate.lidar.time_offset_sigma_s = 1e-4;
  estimate.lidar.unobservable = {"translation along imu z: no rotation about x or y yet"};
  estimate.gyro_bias = {1e-3, 2e-3, 3e-3};
  estimate.quality = {0.3, 0.02, 11, 222, 33};
  estimate.message = "turn the rig";
  return estimate;
}

TEST(Conversions, JointEstimateRoundTrip) {
  const CalibrationEstimate estimate = someEstimate();
  const CalibrationEstimateMsg msg = toEstimateMsg(estimate, {}, {});
  EXPECT_EQ(msg.status, "converging");
  EXPECT_EQ(msg.lidar_camera.header.frame_id, "lidar_link");
  EXPECT_EQ(msg.lidar_camera.child_frame_id, "camera_optical_frame");
  EXPECT_NEAR(msg.lidar_camera.time_offset, 0.035, 1e-15);
  const CalibrationEstimate back = fromEstimateMsg(msg);
  EXPECT_EQ(back.status, estimate.status);
  EXPECT_EQ(back.stamp, estimate.stamp);
  EXPECT_EQ(back.calibration.T_imu_lidar.t, estimate.calibration.T_imu_lidar.t);
  EXPECT_EQ(back.calibration.T_imu_camera.q.coeffs(), estimate.calibration.T_imu_camera.q.coeffs());
  EXPECT_EQ(back.calibration.lidar_time_offset_s, estimate.calibration.lidar_time_offset_s);
  EXPECT_EQ(back.covariance, estimate.covariance);
  EXPECT_EQ(back.camera.sigma, estimate.camera.sigma);
  EXPECT_EQ(back.lidar.unobservable, estimate.lidar.unobservable);
  EXPECT_EQ(back.quality.board_lidar_points, 222);
  EXPECT_EQ(back.message, estimate.message);
}

TEST(Conversions, SubCalibrationCarriesOnlyItsOwnBlocks) {
  const CalibrationEstimate estimate = someEstimate();
  CalibratorDiagnostics diagnostics;
  diagnostics.stage = "refining";
  const ExtrinsicEstimate msg = toExtrinsicMsg(estimate, SensorPart::kLidar, diagnostics, {});
  EXPECT_EQ(msg.stage, "refining");
  EXPECT_EQ(msg.child_frame_id, "lidar_link");
  const CalibrationEstimate back = fromExtrinsicMsg(msg, SensorPart::kLidar);
  EXPECT_FALSE(back.camera.valid);
  EXPECT_TRUE(back.lidar.valid);
  const Matrix6d pose_block = estimate.covariance.block<6, 6>(6, 6);
  const Vector6d cross_block = estimate.covariance.block<6, 1>(6, 13);
  EXPECT_EQ((back.covariance.block<6, 6>(6, 6)), pose_block);
  EXPECT_EQ((back.covariance.block<6, 1>(6, 13)), cross_block);
  EXPECT_EQ(back.covariance(13, 13), estimate.covariance(13, 13));
  EXPECT_TRUE((back.covariance.block<6, 6>(0, 0).isZero(0.0)));
}

TEST(Conversions, NothingBrokenIsSent) {
  CalibrationEstimate estimate = someEstimate();
  estimate.calibration.T_imu_camera.t.x() = std::numeric_limits<double>::quiet_NaN();
  estimate.gyro_bias.y() = std::numeric_limits<double>::infinity();
  const CalibrationEstimateMsg msg = toEstimateMsg(estimate, {}, {});
  EXPECT_FALSE(msg.camera.valid);
  EXPECT_TRUE(msg.lidar.valid);
  EXPECT_EQ(msg.camera.pose.pose.position.x, 0.0);
  EXPECT_EQ(msg.camera.pose.pose.orientation.w, 1.0);
  EXPECT_EQ(msg.gyro_bias.y, 0.0);
}

}  // namespace
}  // namespace cocalib
