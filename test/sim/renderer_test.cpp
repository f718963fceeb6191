#include "cocalib/sim/renderer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>

#include "cocalib/sim/camera.h"
#include "cocalib/sim/random.h"

namespace cocalib::sim {
namespace {

// A camera pose that sees the board from the front, near or far, oblique, anywhere in the picture.
Pose poseBeforeBoard(const Scene& scene, Random& random) {
  const Eigen::Vector3d board_center(0.35, 0.25, 0.0);
  const double distance = random.uniform(1.2, 3.5);
  const Eigen::Vector3d tilt(random.uniform(-0.6, 0.6), random.uniform(-0.6, 0.6), random.uniform(-0.5, 0.5));
  const Eigen::Quaterniond q_B_C = expSo3(tilt);
  const double reach = 0.25 * (distance - 1.0);
  const Eigen::Vector3d shift(random.uniform(-reach, reach), random.uniform(-reach, reach), 0.0);
  return scene.T_W_B() * Pose{q_B_C, board_center - q_B_C * (distance * Eigen::Vector3d::UnitZ() + shift)};
}

struct CornerErrors {
  Eigen::Vector2d mean = Eigen::Vector2d::Zero();
  double rms = 0.0;
  int views = 0;
};

// Mean of (saddle point that OpenCV finds) - (projection) over many poses.
CornerErrors cornerErrors(const Scenario& scenario, double noise, int poses) {
  const Scene scene(scenario);
  const Renderer renderer(scenario, scene);
  const CameraModel camera = scenario.camera.cameraModel();
  const BoardGeometry board = scenario.board.geometry();
  Random random(5, Random::Stream::kCorners);
  CornerErrors errors;
  int corners = 0;
  for (int i = 0; i < poses; ++i) {
    const Pose T_W_C = poseBeforeBoard(scene, random);
    const Pose T_C_B = T_W_C.inverse() * scene.T_W_B();
    std::vector<cv::Point2f> truth;
    bool inside = true;
    for (int c = 0; c < board.cornerCount(); ++c) {
      const std::optional<Eigen::Vector2d> px = camera.project(T_C_B * board.corner(c));
      inside = inside && px && camera.inImage(*px, 12.0) &&
               scene.visible(T_W_C.t, scene.T_W_B() * board.corner(c));  // a tilted camera may stand behind a wall
      if (px) truth.emplace_back(static_cast<float>(px->x()), static_cast<float>(px->y()));
    }
    if (!inside) continue;
    cv::Mat image = renderer.renderStill(T_W_C), gray;
    cv::GaussianBlur(image, image, cv::Size(5, 5), scenario.camera.blur_px);
    for (int p = 0; p < image.rows * image.cols; ++p)
      image.ptr<float>()[p] += static_cast<float>(noise * random.normal());
    image.convertTo(gray, CV_8UC1);
    std::vector<cv::Point2f> found = truth;
    cv::cornerSubPix(gray, found, cv::Size(5, 5), cv::Size(-1, -1),
                     cv::TermCriteria(cv::TermCriteria::EPS + cv::TermCriteria::COUNT, 100, 1e-5));
    for (std::size_t c = 0; c < found.size(); ++c) {
      const Eigen::Vector2d error(found[c].x - truth[c].x, found[c].y - truth[c].y);
      EXPECT_LT(error.norm(), 0.5);
      errors.mean += error;
      errors.rms += error.squaredNorm();
      ++corners;
    }
    ++errors.views;
  }
  errors.mean /= corners;
  errors.rms = std::sqrt(errors.rms / (2.0 * corners));
  return errors;
}

// The saddle-point fit assumes two straight edges; perspective and distortion bend them by a few hundredths of a pixel
// within its window, with either sign. What is left on the mean is the bias of the picture.
TEST(Renderer, BoardCornersAreWhereTheyProject) {
  Scenario scenario;
  const CornerErrors clean = cornerErrors(scenario, 0.0, 50);
  EXPECT_GE(clean.views, 20);
  EXPECT_LT(clean.mean.cwiseAbs().maxCoeff(), 0.01);
  EXPECT_LT(clean.rms, 0.05);
  std::printf("views %d, mean error (%.4f, %.4f) px, rms %.4f px per axis\n", clean.views, clean.mean.x(),
              clean.mean.y(), clean.rms);
  const CornerErrors noisy = cornerErrors(scenario, scenario.camera.noise, 50);
  EXPECT_LT(noisy.mean.cwiseAbs().maxCoeff(), 0.01);
  std::printf("with noise: mean error (%.4f, %.4f) px, rms %.4f px per axis\n", noisy.mean.x(), noisy.mean.y(),
              noisy.rms);
}

TEST(Renderer, BoardCornersOfAFisheyeAreWhereTheyProject) {
  Scenario scenario;
  scenario.camera.model = "pinhole-equi";
  scenario.camera.distortion = {-0.01, 0.02, -0.01, 0.002};
  const CornerErrors errors = cornerErrors(scenario, 0.0, 40);
  EXPECT_GE(errors.views, 20);
  EXPECT_LT(errors.mean.cwiseAbs().maxCoeff(), 0.01);
}

TEST(Renderer, BoardIsFoundInWholePictures) {
  const Scenario scenario;
  const Scene scene(scenario);
  const Trajectory trajectory(scenario);
  const Renderer renderer(scenario, scene);
  const cv::Size size(scenario.board.cols, scenario.board.rows);
  int complete = 0, found = 0;
  for (int k = 0; k < 1000; k += 125) {
    const BoardTruth truth = trueBoard(scenario, scene, trajectory, k);
    if (!truth.complete) continue;
    ++complete;
    std::vector<cv::Point2f> corners;
    if (!cv::findChessboardCornersSB(renderer.render(trajectory, k), size, corners)) continue;
    ++found;
    // The two ends look alike: compare with both orders.
    const Eigen::Vector2d first(corners.front().x, corners.front().y);
    const double distance =
        std::min((first - truth.corners_px.front()).norm(), (first - truth.corners_px.back()).norm());
    EXPECT_LT(distance, 1.0);
  }
  EXPECT_GE(complete, 4);
  EXPECT_EQ(found, complete);
}

TEST(Renderer, OriginSquareIsBlackAndItsNeighboursAreWhite) {
  const Scenario scenario;
  const Scene scene(scenario);
  const Renderer renderer(scenario, scene);
  const CameraModel camera = scenario.camera.cameraModel();
  const Pose T_W_C = scene.T_W_B() * Pose{Eigen::Quaterniond::Identity(), {0.35, 0.25, -1.5}};
  const cv::Mat image = renderer.renderStill(T_W_C);
  const auto grayAt = [&](double x, double y) {
    const Eigen::Vector2d px = *camera.project(T_W_C.inverse() * (scene.T_W_B() * Eigen::Vector3d(x, y, 0.0)));
    return image.at<float>(static_cast<int>(std::lround(px.y())), static_cast<int>(std::lround(px.x())));
  };
  EXPECT_LT(grayAt(-0.05, -0.05), 60);
  EXPECT_GT(grayAt(0.05, -0.05), 180);
  EXPECT_GT(grayAt(-0.05, 0.05), 180);
  EXPECT_LT(grayAt(0.05, 0.05), 60);
  EXPECT_GT(grayAt(-0.125, 0.05), 180);  // the white margin
}

TEST(Renderer, EveryPixelIsDrawn) {
  const Scenario scenario;
  const Scene scene(scenario);
  const Trajectory trajectory(scenario);
  const Renderer renderer(scenario, scene);
  for (const double t : {0.0, 7.0, 23.0}) {
    const cv::Mat image = renderer.renderStill(trajectory.T_W_I(t) * scenario.camera.T_imu_camera());
    double darkest = 0.0, brightest = 0.0;
    cv::minMaxLoc(image, &darkest, &brightest);
    EXPECT_GT(darkest, 15.0);  // nothing is black as the void
    EXPECT_LT(brightest, 240.0);
  }
}

TEST(Renderer, SameSeedSamePictureAnotherSeedAnotherNoise) {
  Scenario scenario;
  scenario.motion = Motion::kStatic;
  const Scene scene(scenario);
  const Trajectory trajectory(scenario);
  const cv::Mat a = Renderer(scenario, scene).render(trajectory, 3),
                b = Renderer(scenario, scene).render(trajectory, 3);
  EXPECT_EQ(cv::norm(a, b, cv::NORM_INF), 0.0);
  scenario.seed = 2;
  const cv::Mat other = Renderer(scenario, scene).render(trajectory, 3);
  // Two independent noises of 2 grey levels (and rounding, 0.29 each) differ by 2.86 in the mean square.
  EXPECT_NEAR(cv::norm(a, other, cv::NORM_L2) / std::sqrt(752.0 * 480.0), 2.86, 0.05);
}

TEST(Renderer, MotionBlurSmearsAndRollingShutterShears) {
  Scenario scenario;
  scenario.camera.noise = 0.0;
  const Scene scene(scenario);
  const Trajectory trajectory(scenario);
  const int k = 292;  // turning with 1.5 rad/s
  const cv::Mat sharp = Renderer(scenario, scene).render(trajectory, k);
  scenario.camera.exposure_s = 0.008;
  const cv::Mat blurred = Renderer(scenario, scene).render(trajectory, k);
  const auto detail = [](const cv::Mat& image) {
    cv::Mat laplacian;
    cv::Laplacian(image, laplacian, CV_32F);
    return cv::norm(laplacian, cv::NORM_L2);
  };
  EXPECT_LT(detail(blurred), 0.8 * detail(sharp));

  scenario.camera.exposure_s = 0.0;
  scenario.camera.line_delay_s = 3e-5;
  const cv::Mat rolling = Renderer(scenario, scene).render(trajectory, k);
  // The middle row is exposed at the stamp, the first and last 7 ms before and after it.
  const auto difference = [&](int row) { return cv::norm(sharp.row(row), rolling.row(row), cv::NORM_L1) / 752.0; };
  EXPECT_LT(difference(239) + difference(240), 2.0);
  EXPECT_GT(difference(0) + difference(479), 6.0);
}

}  // namespace
}  // namespace cocalib::sim
