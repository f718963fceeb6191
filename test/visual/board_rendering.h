#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <opencv2/core.hpp>
#include <opencv2/imgproc.hpp>
#include <random>
#include <vector>

#include "cocalib/measurements/measurements.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib::test {

struct RenderOptions {
  double dark = 40.0, light = 190.0, background = 110.0;  ///< [grey levels]
  double blur_px = 0.5;                                   ///< optical blur, 1 sigma, on top of the pixel's own area
  double noise = 0.0;                                     ///< [grey levels], 1 sigma
  double light_slope = 0.0;                               ///< change of the light across the picture's width, relative
  Eigen::Vector2d motion_px = Eigen::Vector2d::Zero();    ///< smear, in the picture
  bool first_square_light = false;
  std::uint32_t seed = 1;
};

/// Grey level of the board's plane at (x, y) [m], or a negative value beside the board (one square of white margin).
inline double boardLevel(double x, double y, const BoardGeometry& board, const RenderOptions& options) {
  const double u = x / board.square_m, v = y / board.square_m;
  if (u < -2.0 || v < -2.0 || u > board.cols + 1.0 || v > board.rows + 1.0) return -1.0;
  if (u < -1.0 || v < -1.0 || u > board.cols || v > board.rows) return options.light;
  const bool even = (static_cast<int>(std::floor(u)) + static_cast<int>(std::floor(v))) % 2 == 0;
  return even == options.first_square_light ? options.light : options.dark;
}

/// Bearings at the upper left corners of all pixels, row by row, one more each way.
inline std::vector<Eigen::Vector3d> pixelCornerBearings(const CameraModel& camera) {
  std::vector<Eigen::Vector3d> bearings;
  for (int y = 0; y <= camera.height(); ++y) {
    for (int x = 0; x <= camera.width(); ++x) {
      bearings.push_back(camera.unproject({x - 0.5, y - 0.5}).value_or(-Eigen::Vector3d::UnitZ()));
    }
  }
  return bearings;
}

/// Mean grey level over one pixel whose four corners see these places of the board's plane.
inline double pixelLevel(const Eigen::Vector2d& p00, const Eigen::Vector2d& p10, const Eigen::Vector2d& p01,
                         const Eigen::Vector2d& p11, const BoardGeometry& board, const RenderOptions& options) {
  const auto level = [&](const Eigen::Vector2d& p) {
    const double value = boardLevel(p.x(), p.y(), board, options);
    return value < 0.0 ? options.background : value;
  };
  const double first = level(p00);
  // A pixel is smaller than a square: where its corners agree, so does all of it but for slivers at a crossing.
  if (first == level(p10) && first == level(p01) && first == level(p11)) return first;
  constexpr int kSamples = 16;
  double sum = 0.0;
  for (int k = 0; k < kSamples * kSamples; ++k) {
    const double fx = (k % kSamples + 0.5) / kSamples, fy = (k / kSamples + 0.5) / kSamples;
    sum += level((1 - fy) * ((1 - fx) * p00 + fx * p10) + fy * ((1 - fx) * p01 + fx * p11));
  }
  return sum / (kSamples * kSamples);
}

/// Picture of a chessboard on a grey background, each pixel averaged over its area.
/// @param bearings  pixelCornerBearings() of the camera
inline cv::Mat renderBoard(const Pose& T_C_B, const BoardGeometry& board, const CameraModel& camera,
                           const std::vector<Eigen::Vector3d>& bearings, const RenderOptions& options) {
  const int width = camera.width(), height = camera.height();
  const Pose T_B_C = T_C_B.inverse();
  const Eigen::Matrix3d R_B_C = T_B_C.R();
  std::vector<Eigen::Vector2d> places(bearings.size());
  for (std::size_t i = 0; i < bearings.size(); ++i) {
    const Eigen::Vector3d ray_B = R_B_C * bearings[i];
    const double range = -T_B_C.t.z() / ray_B.z();
    places[i] = range > 0.0 ? Eigen::Vector2d((T_B_C.t + range * ray_B).head<2>()) : Eigen::Vector2d(1e6, 1e6);
  }
  cv::Mat picture(height, width, CV_32F);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector2d *upper = &places[y * (width + 1) + x], *lower = upper + width + 1;
      const double light = 1.0 + options.light_slope * (x - 0.5 * width) / width;
      const double level = pixelLevel(upper[0], upper[1], lower[0], lower[1], board, options);
      picture.at<float>(y, x) = static_cast<float>(light * level);
    }
  }
  if (options.blur_px > 0.0) cv::GaussianBlur(picture, picture, cv::Size(), options.blur_px, options.blur_px);
  if (options.motion_px.norm() > 0.0) {
    constexpr int kShifts = 16;
    cv::Mat smeared = cv::Mat::zeros(picture.size(), CV_32F), moved;
    for (int k = 0; k < kShifts; ++k) {
      const Eigen::Vector2d d = ((k + 0.5) / kShifts - 0.5) * options.motion_px;
      const cv::Mat shift = (cv::Mat_<double>(2, 3) << 1, 0, d.x(), 0, 1, d.y());
      cv::warpAffine(picture, moved, shift, picture.size(), cv::INTER_LINEAR, cv::BORDER_REPLICATE);
      smeared += moved / kShifts;
    }
    picture = smeared;
  }
  cv::Mat gray(height, width, CV_8U);
  std::mt19937 random(options.seed);
  std::normal_distribution<double> noise(0.0, 1.0);
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const double value = picture.at<float>(y, x) + options.noise * noise(random);
      gray.at<std::uint8_t>(y, x) = static_cast<std::uint8_t>(std::clamp(std::lround(value), 0L, 255L));
    }
  }
  return gray;
}

}  // namespace cocalib::test
