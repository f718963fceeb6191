#include "cocalib/ros/camera_info.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

namespace cocalib {
namespace {

sensor_msgs::CameraInfo makeInfo(const std::string& model = "plumb_bob",
                                 const std::vector<double>& D = {-0.283, 0.074, 0.0002, 0.00002, 0.0}) {
  sensor_msgs::CameraInfo info;
  info.width = 752;
  info.height = 480;
  info.distortion_model = model;
  info.D = D;
  info.K = {458.654, 0.0, 367.215, 0.0, 457.296, 248.375, 0.0, 0.0, 1.0};
  return info;
}

TEST(CameraInfo, ReadsEveryModel) {
  using Distortion = CameraModel::Distortion;
  std::string problem;
  const std::optional<CameraModel> camera = readCameraInfo(makeInfo(), &problem);
  ASSERT_TRUE(camera) << problem;
  EXPECT_EQ(camera->distortion(), Distortion::kRadTan);
  EXPECT_EQ(camera->intrinsics(), Eigen::Vector4d(458.654, 457.296, 367.215, 248.375));
  EXPECT_EQ(camera->width(), 752);
  EXPECT_EQ(camera->height(), 480);
  EXPECT_EQ(camera->coefficients()[1], 0.074);

  const std::vector<double> eight{0.6, 0.1, 0.0004, -0.0002, 0.005, 0.95, 0.25, 0.02};
  EXPECT_EQ(readCameraInfo(makeInfo("rational_polynomial", eight), nullptr)->distortion(), Distortion::kRational);
  const std::vector<double> four{-0.054, -0.078, 0.096, -0.0515};
  EXPECT_EQ(readCameraInfo(makeInfo("equidistant", four), nullptr)->distortion(), Distortion::kEquidistant);
  EXPECT_EQ(readCameraInfo(makeInfo("fisheye", four), nullptr)->distortion(), Distortion::kEquidistant);
}

TEST(CameraInfo, CoefficientsPaddedWithZerosAreCutOnlyWhereTheyAreZero) {
  std::vector<double> padded{-0.283, 0.074, 0.0002, 0.00002, 0.01, 0.0, 0.0, 0.0};
  EXPECT_EQ(readCameraInfo(makeInfo("plumb_bob", padded), nullptr)->coefficients().size(), 5U);
  padded.back() = 0.1;
  std::string problem;
  EXPECT_FALSE(readCameraInfo(makeInfo("plumb_bob", padded), &problem));
  EXPECT_NE(problem.find("4 or 5 coefficients"), std::string::npos) << problem;
}

TEST(CameraInfo, ACameraWithoutDistortionNeedsNoModelName) {
  EXPECT_TRUE(readCameraInfo(makeInfo("", {}), nullptr));
  EXPECT_TRUE(readCameraInfo(makeInfo("", {0.0, 0.0, 0.0, 0.0, 0.0}), nullptr));
  EXPECT_FALSE(readCameraInfo(makeInfo("", {0.1, 0.0, 0.0, 0.0, 0.0}), nullptr));
}

// The pixel that a camera with binning and a region of interest publishes is the mean of its pixels on the sensor.
TEST(CameraInfo, BinningAndRegionOfInterestAreApplied) {
  sensor_msgs::CameraInfo info = makeInfo();
  const CameraModel full = readCameraInfo(info, nullptr).value();
  info.binning_x = 2;
  info.binning_y = 4;
  info.roi.x_offset = 100;
  info.roi.y_offset = 40;
  info.roi.width = 600;
  info.roi.height = 400;
  const CameraModel part = readCameraInfo(info, nullptr).value();
  EXPECT_EQ(part.width(), 300);
  EXPECT_EQ(part.height(), 100);
  const Eigen::Vector3d p_C(0.2, -0.1, 1.0);
  const Eigen::Vector2d on_sensor = full.project(p_C).value();
  // Its pixel u covers 100 + 2 u and 100 + 2 u + 1 of the sensor, so its centre is 100 + 2 u + 0.5.
  const Eigen::Vector2d expected((on_sensor.x() - 100.5) / 2.0, (on_sensor.y() - 41.5) / 4.0);
  EXPECT_LT((part.project(p_C).value() - expected).norm(), 1e-10);
}

TEST(CameraInfo, SaysWhyItRefuses) {
  using Info = sensor_msgs::CameraInfo;
  const auto says = [](const auto& spoil, const std::string& word) {
    Info info = makeInfo();
    spoil(&info);
    std::string problem;
    EXPECT_FALSE(readCameraInfo(info, &problem));
    EXPECT_EQ(problem.find('\n'), std::string::npos);
    EXPECT_NE(problem.find(word), std::string::npos) << problem;
  };
  says([](Info* i) { i->K.fill(0.0); }, "not calibrated");
  says([](Info* i) { i->K[0] = 0.0; }, "focal");
  says([](Info* i) { i->K[4] = -457.0; }, "focal");
  says([](Info* i) { i->K[2] = std::numeric_limits<double>::quiet_NaN(); }, "finite");
  says([](Info* i) { i->D[0] = std::numeric_limits<double>::infinity(); }, "finite");
  says([](Info* i) { i->D.resize(3); }, "coefficients");
  says([](Info* i) { i->D.assign(1000, 1.0); }, "coefficients");
  says([](Info* i) { i->distortion_model = "thin_prism"; }, "thin_prism");
  says([](Info* i) { i->width = 0; }, "impossible");
  says([](Info* i) { i->height = 0xFFFFFFFF; }, "impossible");
  says([](Info* i) { i->binning_x = 0xFFFFFFFF; }, "binning");
  says(
      [](Info* i) {
        i->roi.x_offset = 0xFFFFFFFF;
        i->roi.width = 10;
        i->roi.height = 10;
      },
      "region of interest");
}

}  // namespace
}  // namespace cocalib
