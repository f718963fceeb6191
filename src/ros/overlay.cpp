#include "cocalib/ros/overlay.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <opencv2/imgproc.hpp>

namespace cocalib {
namespace {

constexpr double kNearM = 1.0, kFarM = 10.0;  // ends of the colour scale, logarithmic

cv::Scalar rangeColour(double range_m) {
  static const cv::Mat table = [] {
    cv::Mat ramp(1, 256, CV_8UC1), colours;
    for (int i = 0; i < 256; ++i) ramp.at<std::uint8_t>(0, i) = static_cast<std::uint8_t>(255 - i);
    cv::applyColorMap(ramp, colours, cv::COLORMAP_JET);
    return colours;
  }();
  const double part = std::log(std::max(range_m, kNearM) / kNearM) / std::log(kFarM / kNearM);
  const auto& colour = table.at<cv::Vec3b>(0, static_cast<int>(std::clamp(part, 0.0, 1.0) * 255.0));
  return {static_cast<double>(colour[0]), static_cast<double>(colour[1]), static_cast<double>(colour[2])};
}

cv::Point toPixel(const Eigen::Vector2d& px) {
  return {static_cast<int>(std::lround(px.x())), static_cast<int>(std::lround(px.y()))};
}

/// Corners of the plate in frame B; the pattern stands in its middle. Without a given size: one square around the
/// inner corners.
std::array<Eigen::Vector3d, 4> plateCorners(const BoardGeometry& board) {
  const Eigen::Vector3d centre(0.5 * (board.cols - 1) * board.square_m, 0.5 * (board.rows - 1) * board.square_m, 0.0);
  const double half_width = 0.5 * board.width_m.value_or((board.cols + 1) * board.square_m);
  const double half_height = 0.5 * board.height_m.value_or((board.rows + 1) * board.square_m);
  const Eigen::Vector3d x = half_width * Eigen::Vector3d::UnitX(), y = half_height * Eigen::Vector3d::UnitY();
  return {centre - x - y, centre + x - y, centre + x + y, centre - x + y};
}

void drawPlate(const Pose& T_C_B, const BoardGeometry& board, const CameraModel& camera, cv::Mat* picture) {
  constexpr int kSteps = 24;  // per side: distortion bends the edges
  const std::array<Eigen::Vector3d, 4> corners = plateCorners(board);
  for (int side = 0; side < 4; ++side) {
    std::optional<Eigen::Vector2d> last;
    for (int step = 0; step <= kSteps; ++step) {
      const double part = static_cast<double>(step) / kSteps;
      const Eigen::Vector3d p_B = (1.0 - part) * corners[side] + part * corners[(side + 1) % 4];
      const std::optional<Eigen::Vector2d> px = camera.project(T_C_B * p_B);
      const bool usable = px && camera.inImage(*px, -100.0);
      if (usable && last) cv::line(*picture, toPixel(*last), toPixel(*px), {255, 0, 255}, 2, cv::LINE_AA);
      last = usable ? px : std::nullopt;
    }
  }
}

bool isOnPlate(const Eigen::Vector3d& p_B, const BoardGeometry& board) {
  constexpr double kThicknessM = 0.1;  // of range noise
  const std::array<Eigen::Vector3d, 4> corners = plateCorners(board);
  return std::abs(p_B.z()) < kThicknessM && p_B.x() > corners[0].x() && p_B.x() < corners[2].x() &&
         p_B.y() > corners[0].y() && p_B.y() < corners[2].y();
}

/// Grows with the picture, so that it can be read where the picture is shown small.
cv::Mat drawLegend(int width, const std::string& caption) {
  const double scale = std::max(0.5, width / 1000.0);
  const int height = static_cast<int>(52 * scale), baseline = static_cast<int>(36 * scale);
  const int bar_width = static_cast<int>(240 * scale), bar_height = static_cast<int>(20 * scale);
  cv::Mat legend(height, width, CV_8UC3, cv::Scalar::all(30));
  const auto write = [&](const std::string& text, int x) {
    cv::putText(legend, text, {x, baseline}, cv::FONT_HERSHEY_SIMPLEX, scale, cv::Scalar::all(235), 1, cv::LINE_AA);
  };
  write(caption, 8);
  const int left = width - bar_width - static_cast<int>(95 * scale);
  if (left < 200) return legend;
  for (int i = 0; i < bar_width; ++i) {
    const double range_m = kNearM * std::pow(kFarM / kNearM, static_cast<double>(i) / bar_width);
    cv::line(legend, {left + i, baseline - bar_height}, {left + i, baseline}, rangeColour(range_m));
  }
  write("1 m", left - static_cast<int>(65 * scale));
  write("10 m", left + bar_width + static_cast<int>(8 * scale));
  return legend;
}

}  // namespace

OverlayCounts countOverlay(const OverlayScene& scene, const OverlayCalibration& with, const CameraModel& camera,
                           const std::optional<BoardGeometry>& board) {
  OverlayCounts counts;
  const std::optional<Pose> T_C_B = boardInCamera(scene, with.calibration, with.T_W_B);
  if (board && T_C_B) {
    const std::array<Eigen::Vector3d, 4> corners = plateCorners(*board);
    counts.whole_board = std::all_of(corners.begin(), corners.end(), [&](const Eigen::Vector3d& corner) {
      const std::optional<Eigen::Vector2d> px = camera.project(*T_C_B * corner);
      return px && camera.inImage(*px);
    });
  }
  for (const Eigen::Vector3d& p_C : pointsInCamera(scene, with.calibration)) {
    const std::optional<Eigen::Vector2d> px = camera.project(p_C);
    if (!px || !camera.inImage(*px)) continue;
    ++counts.visible;
    if (board && T_C_B && isOnPlate(T_C_B->inverse() * p_C, *board)) ++counts.on_board;
  }
  return counts;
}

cv::Mat drawOverlay(const OverlayScene& scene, const OverlayCalibration& with, const CameraModel& camera,
                    const std::optional<BoardGeometry>& board) {
  cv::Mat picture;
  cv::cvtColor(scene.image.gray, picture, cv::COLOR_GRAY2BGR);
  const int radius = std::max(1, picture.cols / 500);
  for (const Eigen::Vector3d& p_C : pointsInCamera(scene, with.calibration)) {
    const std::optional<Eigen::Vector2d> px = camera.project(p_C);
    if (!px || !camera.inImage(*px)) continue;
    cv::circle(picture, toPixel(*px), radius, rangeColour(p_C.norm()), cv::FILLED, cv::LINE_AA);
  }
  const std::optional<Pose> T_C_B = boardInCamera(scene, with.calibration, with.T_W_B);
  if (board && T_C_B) drawPlate(*T_C_B, *board, camera, &picture);
  cv::Mat whole;
  cv::vconcat(drawLegend(picture.cols, with.caption), picture, whole);
  return whole;
}

Calibration nominalCalibration(const std::optional<Pose>& guess_T_imu_camera,
                               const std::optional<Pose>& guess_T_imu_lidar) {
  Calibration nominal;
  Eigen::Matrix3d R_I_C;
  R_I_C << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  nominal.T_imu_camera.q = Eigen::Quaterniond(R_I_C);
  if (guess_T_imu_camera) nominal.T_imu_camera = *guess_T_imu_camera;
  if (guess_T_imu_lidar) nominal.T_imu_lidar = *guess_T_imu_lidar;
  return nominal;
}

}  // namespace cocalib
