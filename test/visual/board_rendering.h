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

/// Picture of a chessboard on a grey background, each pixel averaged over 12 x 12 samples.
inline cv::Mat renderBoard(const Pose& T_C_B, const BoardGeometry& board, const CameraModel& camera,
                           const RenderOptions& options) {
  const int width = camera.width(), height = camera.height();
  const Pose T_B_C = T_C_B.inverse();
  // Board coordinates at the pixels' upper left corners; inside a pixel the mapping is linear to 1e-5 px.
  const double nothing = 1e6;
  std::vector<Eigen::Vector2d> corners((width + 1) * (height + 1));
  for (int y = 0; y <= height; ++y) {
    for (int x = 0; x <= width; ++x) {
      Eigen::Vector2d& out = corners[y * (width + 1) + x];
      out.setConstant(nothing);
      const auto bearing = camera.unproject({x - 0.5, y - 0.5});
      if (!bearing) continue;
      const Eigen::Vector3d ray_B = T_B_C.q * *bearing;
      const double range = -T_B_C.t.z() / ray_B.z();
      if (range > 0.0) out = (T_B_C.t + range * ray_B).head<2>();
    }
  }
  cv::Mat picture(height, width, CV_32F);
  constexpr int kSamples = 12;
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      const Eigen::Vector2d& p00 = corners[y * (width + 1) + x];
      const Eigen::Vector2d& p10 = corners[y * (width + 1) + x + 1];
      const Eigen::Vector2d& p01 = corners[(y + 1) * (width + 1) + x];
      const Eigen::Vector2d& p11 = corners[(y + 1) * (width + 1) + x + 1];
      double sum = 0.0;
      const double far = (board.cols + board.rows + 4) * board.square_m;
      if (p00.norm() > far || p11.norm() > far || p10.norm() > far || p01.norm() > far) {
        sum = options.background * kSamples * kSamples;
      } else {
        for (int k = 0; k < kSamples * kSamples; ++k) {
          const double fx = (k % kSamples + 0.5) / kSamples, fy = (k / kSamples + 0.5) / kSamples;
          const Eigen::Vector2d p = (1 - fy) * ((1 - fx) * p00 + fx * p10) + fy * ((1 - fx) * p01 + fx * p11);
          const double level = boardLevel(p.x(), p.y(), board, options);
          sum += level < 0.0 ? options.background : level;
        }
      }
      const double light = 1.0 + options.light_slope * (x - 0.5 * width) / width;
      picture.at<float>(y, x) = static_cast<float>(light * sum / (kSamples * kSamples));
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
