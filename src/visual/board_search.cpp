#include "cocalib/visual/board_search.h"

#include <algorithm>
#include <opencv2/calib3d.hpp>
#include <opencv2/imgproc.hpp>
#include <vector>

#include "cocalib/visual/board_detector.h"

namespace cocalib {
namespace {

constexpr int kMaxSearchWidthPx = 1000;
constexpr double kMaxRoughRmsPx = 4.0;  // at full size; what is wrong by more is no chessboard seen by this camera

}  // namespace

std::optional<Pose> searchBoard(const cv::Mat& gray, const BoardGeometry& board, const CameraModel& camera,
                                bool coarse) {
  int halvings = coarse ? 1 : 0;
  for (int width = gray.cols; width > kMaxSearchWidthPx; width /= 2) ++halvings;
  const double scale = static_cast<double>(1 << halvings);
  cv::Mat small = gray;
  if (halvings > 0) cv::resize(gray, small, cv::Size(), 1.0 / scale, 1.0 / scale, cv::INTER_AREA);
  std::vector<cv::Point2f> points;
  if (!cv::findChessboardCornersSB(small, cv::Size(board.cols, board.rows), points, cv::CALIB_CB_NORMALIZE_IMAGE) ||
      static_cast<int>(points.size()) != board.cornerCount()) {
    return std::nullopt;
  }
  // Seen from the front, x cross y points away from the camera, which in a picture is clockwise.
  const cv::Point2f along_x = points[board.cols - 1] - points[0];
  const cv::Point2f along_y = points[board.cornerCount() - board.cols] - points[0];
  if (along_x.cross(along_y) < 0.0F) {
    for (int row = 0; row < board.rows; ++row) {
      std::reverse(points.begin() + row * board.cols, points.begin() + (row + 1) * board.cols);
    }
  }
  BoardObservation observation;
  for (const cv::Point2f& point : points) {
    observation.corners_px.emplace_back(static_cast<float>(scale * (point.x + 0.5) - 0.5),
                                        static_cast<float>(scale * (point.y + 0.5) - 0.5));
  }
  double rms_px = 0.0;
  const std::optional<Pose> T_C_B = estimateBoardPose(observation, board, camera, &rms_px);
  if (!T_C_B || rms_px > kMaxRoughRmsPx) return std::nullopt;
  return T_C_B;
}

}  // namespace cocalib
