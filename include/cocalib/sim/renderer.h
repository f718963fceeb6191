#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "cocalib/sim/appearance.h"
#include "cocalib/sim/picture_faults.h"
#include "cocalib/sim/scenario.h"
#include "cocalib/sim/scene.h"
#include "cocalib/sim/trajectory.h"
#include "cocalib/sim/view.h"

namespace cocalib::sim {

/// Draws what the camera sees: each pixel is the mean over its own area (edges and the chessboard are integrated, the
/// rest is a filtered texture), then blurred by the lens, with white noise, rounded to 8 bits. The centre of the first
/// pixel is (0, 0). Immutable after construction; safe from any thread; the same picture from any thread.
class Renderer {
 public:
  /// Paints the textures (about a second).
  /// @throws std::invalid_argument if the camera sees 85 deg or more off its axis
  Renderer(const Scenario& scenario, const Scene& scene);

  /// Picture k (CV_8UC1) with the scenario's motion blur, rolling shutter, faults, lens blur and noise.
  cv::Mat render(const Trajectory& trajectory, int k) const;

  /// A sharp picture from a fixed pose, CV_32FC1, without blur or noise.
  cv::Mat renderStill(const Pose& T_W_C) const;

 private:
  /// Adds weight * (what is seen from T_W_C) to rows [first, last) of `image` (CV_32FC1).
  void drawRows(const Pose& T_W_C, int first, int last, float weight, cv::Mat& image) const;
  Tile tileAt(int col, int row, int last_row) const;
  void drawCovered(const View& view, const Tile& tile, float weight, cv::Mat& image) const;
  void drawMixed(const Views& views, const Tile& tile, float weight, cv::Mat& image) const;
  /// Mean grey value of one view over a pixel, as if it covered all of it.
  float shadePixel(const View& view, int col, int row) const;
  /// Mean grey value over a pixel that several views, or squares of the board, share.
  float shadeEdge(const Views& views, int col, int row) const;
  /// Mean grey value around `ray` over one of parts x parts parts of a pixel.
  float shadePart(const View& view, const Eigen::Vector2f& ray, const Eigen::Matrix2f& ray_step, int parts) const;

  cv::Mat expose(const Trajectory& trajectory, double t) const;
  double blurLength(const Trajectory& trajectory, double t) const;

  const Eigen::Vector2f& cornerRay(int col, int row) const { return corner_rays_[row * (width_ + 1) + col]; }
  const Eigen::Vector2f& centerRay(int col, int row) const { return center_rays_[row * width_ + col]; }
  /// Derivative of the ray with the pixel: columns d/dcol, d/drow.
  Eigen::Matrix2f rayStep(int col, int row) const;
  /// Ray through a point of the pixel, x and y from 0 (its left or upper border) to 1.
  Eigen::Vector2f rayIn(int col, int row, float x, float y) const;

  Scenario scenario_;
  Scene scene_;
  Pose T_I_C_;
  int width_, height_;
  std::vector<Eigen::Vector2f> corner_rays_, center_rays_;  // (x/z, y/z)
  std::vector<Texture> textures_;                           // one for each rectangle but the board
  BoardPattern pattern_;
  PictureFaults faults_;
  std::vector<float> noise_;  // white, unit variance; each row of a picture begins somewhere in it
};

}  // namespace cocalib::sim
