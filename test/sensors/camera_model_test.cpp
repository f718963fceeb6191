#include "cocalib/sensors/camera_model.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <opencv2/calib3d.hpp>
#include <random>
#include <stdexcept>
#include <string>

namespace cocalib {
namespace {

using Distortion = CameraModel::Distortion;

const Eigen::Vector4d kIntrinsics(458.654, 457.296, 367.215, 248.375);

/// One realistic camera of every kind.
std::vector<CameraModel> allModels() {
  return {
      CameraModel(Distortion::kRadTan, kIntrinsics, {}, 752, 480),
      CameraModel(Distortion::kRadTan, kIntrinsics, {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05}, 752, 480),
      CameraModel(Distortion::kRadTan, kIntrinsics, {-0.31, 0.12, 0.0009, -0.0013, -0.021}, 752, 480),
      CameraModel(Distortion::kRational, kIntrinsics, {0.6, 0.1, 0.0004, -0.0002, 0.005, 0.95, 0.25, 0.02}, 752, 480),
      CameraModel(Distortion::kEquidistant, {1176.93, 1177.72, 962.275, 612.725},
                  {-0.0540096, -0.0784275, 0.0959641, -0.0515253}, 1920, 1208),
  };
}

/// A point whose bearing falls into the picture.
Eigen::Vector3d randomVisiblePoint(const CameraModel& camera, std::mt19937& random) {
  std::uniform_real_distribution<double> unit(0.0, 1.0);
  const Eigen::Vector2d px(unit(random) * (camera.width() - 1), unit(random) * (camera.height() - 1));
  return camera.unproject(px).value() * (0.5 + 10.0 * unit(random));
}

Eigen::Vector2d openCvProject(const CameraModel& camera, const Eigen::Vector3d& p_C) {
  const Eigen::Vector4d& k = camera.intrinsics();
  const cv::Matx33d K(k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, 1.0);
  const std::vector<cv::Point3d> points{{p_C.x(), p_C.y(), p_C.z()}};
  std::vector<cv::Point2d> pixels;
  if (camera.distortion() == Distortion::kEquidistant) {
    cv::fisheye::projectPoints(points, pixels, cv::Vec3d(), cv::Vec3d(), K, camera.coefficients());
  } else {
    cv::projectPoints(points, cv::Vec3d(), cv::Vec3d(), K, camera.coefficients(), pixels);
  }
  return {pixels[0].x, pixels[0].y};
}

TEST(CameraModel, ProjectsAsOpenCv) {
  std::mt19937 random(1);
  for (const CameraModel& camera : allModels()) {
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d p_C = randomVisiblePoint(camera, random);
      EXPECT_LT((camera.project(p_C).value() - openCvProject(camera, p_C)).norm(), 1e-9);
    }
  }
}

TEST(CameraModel, JacobianMatchesCentralDifferences) {
  std::mt19937 random(2);
  for (const CameraModel& camera : allModels()) {
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d p_C = randomVisiblePoint(camera, random);
      Eigen::Matrix<double, 2, 3> J, numeric;
      camera.project(p_C, &J);
      const double step = 1e-6 * p_C.norm();
      for (int axis = 0; axis < 3; ++axis) {
        const Eigen::Vector3d delta = step * Eigen::Vector3d::Unit(axis);
        numeric.col(axis) = (camera.project(p_C + delta).value() - camera.project(p_C - delta).value()) / (2.0 * step);
      }
      EXPECT_TRUE(J.isApprox(numeric, 1e-7)) << J << "\n" << numeric;
    }
  }
}

TEST(CameraModel, JacobianOnTheOpticalAxisIsThePinholes) {
  for (const CameraModel& camera : allModels()) {
    Eigen::Matrix<double, 2, 3> J, expected;
    const Eigen::Vector2d px = camera.project({0.0, 0.0, 2.0}, &J).value();
    expected << camera.intrinsics()[0] / 2.0, 0.0, 0.0, 0.0, camera.intrinsics()[1] / 2.0, 0.0;
    EXPECT_LT((J - expected).norm(), 1e-9);
    EXPECT_LT((px - camera.intrinsics().tail<2>()).norm(), 1e-12);
  }
}

TEST(CameraModel, UnprojectInvertsProjectOverTheWholePicture) {
  for (const CameraModel& camera : allModels()) {
    for (double v = 0.0; v < camera.height(); v += 13.7) {
      for (double u = 0.0; u < camera.width(); u += 17.3) {
        const std::optional<Eigen::Vector3d> bearing = camera.unproject({u, v});
        ASSERT_TRUE(bearing.has_value()) << u << " " << v;
        EXPECT_NEAR(bearing->norm(), 1.0, 1e-14);
        EXPECT_LT((camera.project(*bearing).value() - Eigen::Vector2d(u, v)).norm(), 1e-8);
      }
    }
  }
}

TEST(CameraModel, UnprojectOfTheProjectionIsTheBearing) {
  std::mt19937 random(3);
  for (const CameraModel& camera : allModels()) {
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d bearing = randomVisiblePoint(camera, random).normalized();
      EXPECT_LT((camera.unproject(camera.project(bearing).value()).value() - bearing).norm(), 1e-10);
    }
  }
}

TEST(CameraModel, NothingBehindTheCamera) {
  for (const CameraModel& camera : allModels()) {
    EXPECT_FALSE(camera.project({0.1, 0.2, 0.0}));
    EXPECT_FALSE(camera.project({0.1, 0.2, -1.0}));
    EXPECT_FALSE(camera.project({0.1, 0.2, std::numeric_limits<double>::quiet_NaN()}));
    EXPECT_FALSE(camera.project({std::numeric_limits<double>::quiet_NaN(), 0.2, 1.0}));
    EXPECT_FALSE(camera.unproject({std::numeric_limits<double>::infinity(), 0.0}));
  }
}

// r (1 - 0.3 r^2) is largest where 1 - 0.9 r^2 = 0, so at r = 1.0541: beyond, a second point has the same pixel.
TEST(CameraModel, NothingWhereTheDistortionFoldsOver) {
  const CameraModel camera(Distortion::kRadTan, kIntrinsics, {-0.3, 0.0, 0.0, 0.0}, 752, 480);
  const double fold = std::sqrt(1.0 / 0.9);
  EXPECT_TRUE(camera.project({fold - 1e-6, 0.0, 1.0}));
  EXPECT_FALSE(camera.project({fold + 1e-6, 0.0, 1.0}));
  const double edge_px = kIntrinsics[0] * fold * (1.0 - 0.3 / 0.9);
  EXPECT_TRUE(camera.unproject({kIntrinsics[2] + edge_px - 1e-3, kIntrinsics[3]}));
  EXPECT_FALSE(camera.unproject({kIntrinsics[2] + edge_px + 1e-3, kIntrinsics[3]}));
}

TEST(CameraModel, FisheyeFoldsOverWhereItsPolynomialTurns) {
  const CameraModel camera(Distortion::kEquidistant, kIntrinsics, {-0.2, 0.0, 0.0, 0.0}, 752, 480);
  const double fold = std::sqrt(1.0 / 0.6);  // 1 - 3 * 0.2 * angle^2 = 0
  EXPECT_TRUE(camera.project({std::sin(fold - 1e-6), 0.0, std::cos(fold - 1e-6)}));
  EXPECT_FALSE(camera.project({std::sin(fold + 1e-6), 0.0, std::cos(fold + 1e-6)}));
}

TEST(CameraModel, NamesOfRigFileAndCameraInfo) {
  const std::vector<double> four(4, 0.01);
  EXPECT_EQ(CameraModel::fromName("pinhole-radtan", kIntrinsics, four, 752, 480).distortion(), Distortion::kRadTan);
  EXPECT_EQ(CameraModel::fromName("plumb_bob", kIntrinsics, four, 752, 480).distortion(), Distortion::kRadTan);
  EXPECT_EQ(CameraModel::fromName("pinhole-equi", kIntrinsics, four, 752, 480).distortion(), Distortion::kEquidistant);
  EXPECT_EQ(CameraModel::fromName("equidistant", kIntrinsics, four, 752, 480).distortion(), Distortion::kEquidistant);
  EXPECT_EQ(CameraModel::fromName("fisheye", kIntrinsics, four, 752, 480).distortion(), Distortion::kEquidistant);
  EXPECT_EQ(
      CameraModel::fromName("rational_polynomial", kIntrinsics, std::vector<double>(8, 0.0), 752, 480).distortion(),
      Distortion::kRational);
  EXPECT_THROW(CameraModel::fromName("omni", kIntrinsics, four, 752, 480), std::invalid_argument);
}

TEST(CameraModel, RefusesWhatCannotBeACamera) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto build = [](const Eigen::Vector4d& k, const std::vector<double>& d, int w, int h) {
    return CameraModel(Distortion::kRadTan, k, d, w, h);
  };
  EXPECT_THROW(build({0.0, 0.0, 0.0, 0.0}, {}, 752, 480), std::invalid_argument);
  EXPECT_THROW(build({-458.0, 457.0, 367.0, 248.0}, {}, 752, 480), std::invalid_argument);
  EXPECT_THROW(build({nan, 457.0, 367.0, 248.0}, {}, 752, 480), std::invalid_argument);
  EXPECT_THROW(build(kIntrinsics, {0.1, 0.2, 0.3}, 752, 480), std::invalid_argument);
  EXPECT_THROW(build(kIntrinsics, {nan, 0.0, 0.0, 0.0}, 752, 480), std::invalid_argument);
  EXPECT_THROW(build(kIntrinsics, {}, 0, 480), std::invalid_argument);
  EXPECT_THROW(build(kIntrinsics, {}, 752, 1 << 20), std::invalid_argument);
  EXPECT_THROW(CameraModel(Distortion::kRational, kIntrinsics, {0.1, 0.2, 0.0, 0.0, 0.1}, 752, 480),
               std::invalid_argument);
  EXPECT_THROW(CameraModel(Distortion::kEquidistant, kIntrinsics, {}, 752, 480), std::invalid_argument);
  EXPECT_THROW(build(kIntrinsics, {1e308, 0.0, 0.0, 0.0}, 752, 480), std::invalid_argument);
  EXPECT_THROW(build(kIntrinsics, {-100.0, 0.0, 0.0, 0.0}, 752, 480), std::invalid_argument);  // folds at once
}

TEST(CameraModel, ImageBorder) {
  const CameraModel camera(Distortion::kRadTan, kIntrinsics, {}, 752, 480);
  EXPECT_TRUE(camera.inImage({0.0, 0.0}));
  EXPECT_TRUE(camera.inImage({751.0, 479.0}));
  EXPECT_FALSE(camera.inImage({751.1, 479.0}));
  EXPECT_FALSE(camera.inImage({0.0, 0.0}, 1.0));
}

}  // namespace
}  // namespace cocalib
