#include "cocalib/ros/board_size_check.h"

#include <algorithm>
#include <opencv2/calib3d.hpp>

namespace cocalib {
namespace {

constexpr TimeNs kPeriodNs = 1'000'000'000;
constexpr int kAgreeing = 3;        // pictures that must say the same
constexpr float kBorder_px = 8.0F;  // a corner nearer to the border than this is not found
constexpr int kMostLooks = 30;      // after that there is no board in this recording

/// Longer side first: which side is which depends on how the board is held.
cv::Size sorted(int a, int b) { return {std::max(a, b), std::min(a, b)}; }

/// Whether a further row of corners all around would have been in the picture. A board cut by the picture's border
/// shows fewer corners than it has, and says nothing of its size.
bool isWhole(const cv::Mat& corners, const cv::Size& grid, const cv::Size& picture) {
  const auto at = [&](int row, int col) { return corners.at<cv::Point2f>(row * grid.width + col); };
  const auto inside = [&](const cv::Point2f& p) {
    return p.x >= kBorder_px && p.y >= kBorder_px && p.x < static_cast<float>(picture.width) - kBorder_px &&
           p.y < static_cast<float>(picture.height) - kBorder_px;
  };
  const auto beyond = [](const cv::Point2f& last, const cv::Point2f& before) { return last + (last - before); };
  const int right = grid.width - 1, bottom = grid.height - 1;
  for (int row = 0; row <= bottom; ++row) {
    if (!inside(beyond(at(row, 0), at(row, 1))) || !inside(beyond(at(row, right), at(row, right - 1)))) return false;
  }
  for (int col = 0; col <= right; ++col) {
    if (!inside(beyond(at(0, col), at(1, col))) || !inside(beyond(at(bottom, col), at(bottom - 1, col)))) return false;
  }
  return true;
}

/// Inner corners of any chessboard of at least 3 x 3 in the picture that is not just a part of `expected`.
std::optional<cv::Size> findAnyBoard(const cv::Mat& gray, const cv::Size& expected) {
  cv::Mat corners, cells;
  const bool found =
      cv::findChessboardCornersSB(gray, {3, 3}, corners, cv::CALIB_CB_LARGER | cv::CALIB_CB_EXHAUSTIVE, cells);
  if (!found || cells.rows < 3 || cells.cols < 3) return std::nullopt;
  const cv::Size size = sorted(cells.cols, cells.rows);
  const bool may_be_part = size.width <= expected.width && size.height <= expected.height;
  if (may_be_part && !isWhole(corners, cells.size(), gray.size())) return std::nullopt;
  return size;
}

}  // namespace

std::optional<std::string> BoardSizeCheck::look(const ImageFrame& image) {
  if (finished_ || looks_ >= kMostLooks) return std::nullopt;
  if (last_look_ && image.stamp - *last_look_ < kPeriodNs) return std::nullopt;
  last_look_ = image.stamp;
  ++looks_;
  const cv::Size expected = sorted(board_.cols, board_.rows);
  const std::optional<cv::Size> size = findAnyBoard(image.gray, expected);
  if (!size || *size == expected) return std::nullopt;
  found_.push_back(*size);
  if (std::count(found_.begin(), found_.end(), *size) < kAgreeing) return std::nullopt;
  finished_ = true;
  return "the board in the pictures has " + std::to_string(size->width) + " x " + std::to_string(size->height) +
         " inner corners, not " + std::to_string(board_.cols) + " x " + std::to_string(board_.rows);
}

}  // namespace cocalib
