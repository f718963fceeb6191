#include "cocalib/ros/board_size_check.h"

#include <gtest/gtest.h>

#include <opencv2/imgproc.hpp>

namespace cocalib {
namespace {

/// A board of cols x rows inner corners, drawn with its first corner's square at `origin`; it may leave the picture.
cv::Mat pictureOf(int cols, int rows, const cv::Point& origin) {
  constexpr int kSquare = 30;
  cv::Mat picture(480, 752, CV_8UC1, cv::Scalar(255));
  for (int row = 0; row <= rows; ++row) {
    for (int col = 0; col <= cols; ++col) {
      if ((row + col) % 2 != 0) continue;
      const cv::Rect square(origin.x + col * kSquare, origin.y + row * kSquare, kSquare, kSquare);
      cv::rectangle(picture, square, cv::Scalar(0), cv::FILLED);
    }
  }
  cv::GaussianBlur(picture, picture, cv::Size(), 0.8);
  return picture;
}

BoardGeometry board(int cols, int rows) {
  BoardGeometry geometry;
  geometry.cols = cols;
  geometry.rows = rows;
  geometry.square_m = 0.1;
  return geometry;
}

std::optional<std::string> lookFor(double seconds, BoardSizeCheck* check, const cv::Mat& picture) {
  for (double t = 0.0; t < seconds; t += 0.5) {
    if (const auto problem = check->look({toNs(100.0 + t), picture})) return problem;
  }
  return std::nullopt;
}

TEST(BoardSizeCheck, NamesTheSizeOfAnotherBoard) {
  BoardSizeCheck check(board(8, 6));
  const auto problem = lookFor(5.0, &check, pictureOf(7, 5, {200, 100}));
  ASSERT_TRUE(problem);
  EXPECT_EQ(*problem, "the board in the pictures has 7 x 5 inner corners, not 8 x 6");
}

TEST(BoardSizeCheck, ABoardCutByTheBorderSaysNothing) {
  BoardSizeCheck check(board(8, 6));
  EXPECT_FALSE(lookFor(10.0, &check, pictureOf(8, 6, {600, 350})));  // 4 x 3 corners are left in the picture
}

TEST(BoardSizeCheck, TheRightBoardIsNoProblemEitherWayRound) {
  BoardSizeCheck check(board(6, 8));
  EXPECT_FALSE(lookFor(10.0, &check, pictureOf(8, 6, {200, 100})));
}

}  // namespace
}  // namespace cocalib
