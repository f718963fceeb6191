#include "cocalib/visual/board_detector.h"

#include <gtest/gtest.h>

#include <cmath>
#include <stdexcept>

#include "visual/board_rendering.h"

namespace cocalib {
namespace {

using test::renderBoard;
using test::RenderOptions;

const BoardGeometry kBoard{8, 6, 0.1, {}, {}};
const BoardGeometry kOddBoard{7, 6, 0.1, {}, {}};  // colours tell which way round it is
const CameraModel kCamera(CameraModel::Distortion::kRadTan, {458.0, 457.0, 367.0, 248.0},
                          {-0.283, 0.0739, 0.0002, 1.7e-5}, 752, 480);
const std::vector<Eigen::Vector3d> kBearings = test::pixelCornerBearings(kCamera);
constexpr TimeNs kFramePeriod = 50000000;

/// T_C_B of a board whose middle stands at `middle`, turned from facing the camera by the rotation vector `tilt`.
Pose boardAt(const Eigen::Vector3d& middle, const Eigen::Vector3d& tilt, const BoardGeometry& board = kBoard) {
  const Eigen::Quaterniond q = expSo3(tilt);
  const Eigen::Vector3d half(0.5 * (board.cols - 1) * board.square_m, 0.5 * (board.rows - 1) * board.square_m, 0.0);
  return {q, middle - q * half};
}

struct CornerErrors {
  double rms_px = 0.0, max_px = 0.0;
};
CornerErrors compare(const BoardObservation& observation, const Pose& T_C_B, const BoardGeometry& board = kBoard) {
  CornerErrors errors;
  for (int i = 0; i < board.cornerCount(); ++i) {
    const double error = (observation.corners_px[i].cast<double>() - *kCamera.project(T_C_B * board.corner(i))).norm();
    errors.rms_px += error * error / board.cornerCount();
    errors.max_px = std::max(errors.max_px, error);
  }
  errors.rms_px = std::sqrt(errors.rms_px);
  return errors;
}

ImageFrame frame(int index, const Pose& T_C_B, RenderOptions options = {}, const BoardGeometry& board = kBoard) {
  options.seed = static_cast<std::uint32_t>(index + 1);
  return {index * kFramePeriod, renderBoard(T_C_B, board, kCamera, kBearings, options)};
}

TEST(BoardDetector, FindsCornersToAFewHundredthsOfAPixel) {
  BoardDetector detector(kBoard, kCamera, {});
  const Pose T_C_B = boardAt({0.3, 0.1, 2.4}, {0.4, -0.3, 0.2});
  RenderOptions options;
  options.noise = 2.5;
  options.light_slope = 0.5;
  const auto observation = detector.detect(frame(0, T_C_B, options));
  ASSERT_TRUE(observation);
  ASSERT_EQ(observation->corners_px.size(), 48U);
  const CornerErrors errors = compare(*observation, T_C_B);
  EXPECT_LT(errors.rms_px, 0.03);  // both axes together; measured 0.015
  EXPECT_LT(errors.max_px, 0.1);
  ASSERT_TRUE(detector.lastPose());
  EXPECT_LT((detector.lastPose()->t - T_C_B.t).norm(), 0.002);
  EXPECT_LT(detector.lastPose()->q.angularDistance(T_C_B.q), 0.001);
}

TEST(BoardDetector, FollowsAFastMovingBoardWithOneSearch) {
  BoardDetector detector(kBoard, kCamera, {});
  RenderOptions options;
  options.noise = 2.5;
  for (int k = 0; k < 12; ++k) {
    const double t = 0.05 * k;
    // Starts gently, then turns at up to 1.2 rad/s: tens of pixels from picture to picture.
    const Pose T_C_B = boardAt({0.5 * std::sin(2.0 * t), 0.25 * std::sin(3.0 * t), 2.2}, {0.3, 0.2 + t, 0.9 * t});
    const auto observation = detector.detect(frame(k, T_C_B, options));
    ASSERT_TRUE(observation) << "picture " << k;
    EXPECT_LT(compare(*observation, T_C_B).rms_px, 0.04) << "picture " << k;
  }
  EXPECT_EQ(detector.searches(), 1);
}

TEST(BoardDetector, KeepsTheBoardThroughSlightMotionBlur) {
  BoardDetector detector(kBoard, kCamera, {});
  RenderOptions options;
  options.noise = 2.0;
  for (int k = 0; k < 4; ++k) {
    options.motion_px = k == 0 ? Eigen::Vector2d::Zero() : Eigen::Vector2d(2.0 * k, 1.0 * k);
    const Pose T_C_B = boardAt({0.2 + 0.02 * k, 0.0, 1.9}, {0.1, -0.2, 0.1});
    const auto observation = detector.detect(frame(k, T_C_B, options));
    ASSERT_TRUE(observation) << "picture " << k;
    EXPECT_LT(compare(*observation, T_C_B).rms_px, 0.1) << "picture " << k;
  }
}

TEST(BoardDetector, RefusesABoardPartlyOutOfView) {
  BoardDetector detector(kBoard, kCamera, {});
  ASSERT_TRUE(detector.detect(frame(0, boardAt({0.9, 0.0, 2.0}, {0.0, 0.2, 0.0}))));
  EXPECT_FALSE(detector.detect(frame(1, boardAt({1.35, 0.0, 2.0}, {0.0, 0.2, 0.0}))));
  EXPECT_TRUE(detector.detect(frame(2, boardAt({0.9, 0.0, 2.0}, {0.0, 0.2, 0.0}))));
}

TEST(BoardDetector, RefusesACoveredCorner) {
  BoardDetector detector(kBoard, kCamera, {});
  const Pose T_C_B = boardAt({0.0, 0.0, 2.0}, {0.2, 0.1, 0.0});
  ASSERT_TRUE(detector.detect(frame(0, T_C_B)));
  const ImageFrame covered = frame(1, T_C_B);
  const Eigen::Vector2d px = *kCamera.project(T_C_B * kBoard.corner(19));
  cv::circle(covered.gray, cv::Point(static_cast<int>(px.x()), static_cast<int>(px.y())), 9, cv::Scalar(90),
             cv::FILLED);
  EXPECT_FALSE(detector.detect(covered));
}

TEST(BoardDetector, KeepsItsNumberingWhileTheBoardTurnsOver) {
  BoardDetector detector(kBoard, kCamera, {});
  for (int k = 0; k <= 20; ++k) {
    const Pose T_C_B = boardAt({0.0, 0.0, 2.0}, {0.0, 0.0, 0.16 * k});
    const auto observation = detector.detect(frame(k, T_C_B));
    ASSERT_TRUE(observation) << "picture " << k;
    EXPECT_LT(compare(*observation, T_C_B).max_px, 0.2) << "picture " << k;
  }
}

TEST(BoardDetector, ResolvesTheHalfTurnAfterALossByRotationsGiven) {
  const cv::Mat dark(480, 752, CV_8U, cv::Scalar(30));
  for (const bool rotations_given : {true, false}) {
    BoardDetector detector(kBoard, kCamera, {});
    ASSERT_TRUE(detector.detect(frame(0, boardAt({0.0, 0.0, 2.0}, Eigen::Vector3d::Zero()))));
    // In the dark the camera rolls by 2.4 rad; x then points left in the picture.
    for (int k = 1; k <= 12; ++k) {
      std::optional<Eigen::Quaterniond> R_Cnow_Cprev;
      if (rotations_given) R_Cnow_Cprev = expSo3({0.0, 0.0, 0.2});
      EXPECT_FALSE(detector.detect({k * kFramePeriod, dark}, R_Cnow_Cprev));
    }
    const Pose T_C_B = boardAt({0.0, 0.0, 2.0}, {0.0, 0.0, 2.4});
    std::optional<BoardObservation> observation;
    for (int k = 20; !observation && k < 40; ++k) {
      std::optional<Eigen::Quaterniond> R_Cnow_Cprev;
      if (rotations_given) R_Cnow_Cprev = Eigen::Quaterniond::Identity();
      observation = detector.detect(frame(k, T_C_B), R_Cnow_Cprev);
    }
    ASSERT_TRUE(observation);
    const bool right = compare(*observation, T_C_B).max_px < 1.0;
    EXPECT_EQ(right, rotations_given);  // without them x is taken to point right still
  }
}

TEST(BoardDetector, PredictedPoseFindsTheBoardWithoutSearchAndTheRightWayRound) {
  BoardDetector::Params params;
  params.search_period_s = 1e6;
  BoardDetector detector(kBoard, kCamera, params);
  const cv::Mat dark(480, 752, CV_8U, cv::Scalar(30));
  EXPECT_FALSE(detector.detect({0, dark}));
  const Pose T_C_B = boardAt({0.1, 0.1, 2.0}, {0.1, 0.2, 3.0});
  detector.setPredictedPose({expSo3({0.02, -0.02, 0.02}) * T_C_B.q, T_C_B.t + Eigen::Vector3d(0.06, -0.05, 0.05)});
  const auto observation = detector.detect(frame(1, T_C_B));
  ASSERT_TRUE(observation);
  EXPECT_LT(compare(*observation, T_C_B).max_px, 0.2);
  EXPECT_EQ(detector.searches(), 1);
}

TEST(BoardDetector, ColoursTellTheOriginWhereTheyCan) {
  for (const double roll : {0.3, 0.3 + M_PI}) {
    BoardDetector detector(kOddBoard, kCamera, {});
    const Pose T_C_B = boardAt({0.0, 0.0, 2.0}, {0.0, 0.0, roll}, kOddBoard);
    const auto observation = detector.detect(frame(0, T_C_B, {}, kOddBoard));
    ASSERT_TRUE(observation);
    EXPECT_LT(compare(*observation, T_C_B, kOddBoard).max_px, 0.2);
  }
}

TEST(BoardDetector, TakesABoardWithLightOuterSquares) {
  BoardDetector detector(kBoard, kCamera, {});
  RenderOptions options;
  options.first_square_light = true;
  const Pose T_C_B = boardAt({0.0, 0.0, 2.0}, {0.2, 0.0, 0.3});
  const auto observation = detector.detect(frame(0, T_C_B, options));
  ASSERT_TRUE(observation);
  EXPECT_LT(compare(*observation, T_C_B).max_px, 0.2);
}

TEST(BoardDetector, NumberingIsNeverMirrored) {
  for (int k = 0; k < 6; ++k) {
    BoardDetector detector(kBoard, kCamera, {});
    const Pose T_C_B = boardAt({0.0, 0.0, 2.2}, {0.2, -0.3, 1.0 * k});
    ASSERT_TRUE(detector.detect(frame(0, T_C_B)));
    EXPECT_GT(detector.lastPose()->R()(2, 2), 0.0);  // z points into the board, away from the camera
  }
}

TEST(BoardDetector, SameInputsSameCorners) {
  const ImageFrame image = frame(0, boardAt({0.0, 0.0, 2.0}, {0.3, 0.2, 0.1}));
  BoardDetector first(kBoard, kCamera, {}), second(kBoard, kCamera, {});
  const auto a = first.detect(image), b = second.detect(image);
  ASSERT_TRUE(a && b);
  for (int i = 0; i < 48; ++i) EXPECT_EQ(a->corners_px[i], b->corners_px[i]);
}

TEST(BoardDetector, SurvivesOddPictures) {
  BoardDetector detector(kBoard, kCamera, {});
  EXPECT_FALSE(detector.detect({0, cv::Mat()}));
  EXPECT_FALSE(detector.detect({1, cv::Mat(100, 100, CV_8U, cv::Scalar(0))}));
  EXPECT_FALSE(detector.detect({2, cv::Mat(480, 752, CV_16U, cv::Scalar(0))}));
  const Pose T_C_B = boardAt({0.0, 0.0, 2.0}, {0.3, 0.2, 0.1});
  ASSERT_TRUE(detector.detect(frame(40, T_C_B)));
  EXPECT_TRUE(detector.detect(frame(10, T_C_B)));  // the bag starts again
}

TEST(BoardDetector, RefusesImpossibleSettings) {
  EXPECT_THROW(BoardDetector({2, 6, 0.1, {}, {}}, kCamera, {}), std::invalid_argument);
  EXPECT_THROW(BoardDetector({8, 6, 0.0, {}, {}}, kCamera, {}), std::invalid_argument);
  BoardDetector::Params params;
  params.max_reprojection_px = -1.0;
  EXPECT_THROW(BoardDetector(kBoard, kCamera, params), std::invalid_argument);
}

TEST(EstimateBoardPose, IsExactOnExactCorners) {
  const Pose T_C_B = boardAt({0.4, -0.2, 2.5}, {0.5, -0.4, 1.2});
  BoardObservation observation;
  for (int i = 0; i < 48; ++i) {
    observation.corners_px.push_back(kCamera.project(T_C_B * kBoard.corner(i))->cast<float>());
  }
  double rms_px = 1.0;
  const auto pose = estimateBoardPose(observation, kBoard, kCamera, &rms_px);
  ASSERT_TRUE(pose);
  EXPECT_LT(rms_px, 1e-4);  // pixels are floats
  EXPECT_LT(pose->minus(T_C_B).norm(), 1e-5);
}

TEST(EstimateBoardPose, RefusesWrongCounts) { EXPECT_FALSE(estimateBoardPose(BoardObservation{}, kBoard, kCamera)); }

}  // namespace
}  // namespace cocalib
