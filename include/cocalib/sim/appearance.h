#pragma once

#include <Eigen/Core>
#include <opencv2/core/mat.hpp>
#include <vector>

#include "cocalib/sim/scene.h"

namespace cocalib::sim {

/// Grey picture on a rectangle, with ever coarser copies for a filtered look-up from any distance.
/// Immutable; safe from any thread.
class Texture {
 public:
  /// Shapes of many sizes painted over each other, so that there are corners to track at every distance.
  /// @param index  number of the rectangle; each has its own picture, the same in every run
  Texture(const Rectangle& rectangle, int index);

  /// Level of detail at which a texel is as long as `footprint_m` [m] of the surface; 0 is the finest.
  float level(float footprint_m) const;

  /// Grey value [0, 255] at (a, b) [m] along u and v from the rectangle's centre, interpolated between texels and
  /// levels.
  float gray(float a, float b, float level) const;

 private:
  static constexpr float kTexel_m = 0.004F;
  static constexpr int kPadding = 2;  // texels repeated beyond the border, so that the look-up needs no bounds check

  float bilinear(int level, float a, float b) const;

  struct Level {
    cv::Mat picture;     // CV_8UC1, padded
    float per_u, per_v;  // texels per metre
    float cols, rows;    // without padding
  };
  float half_u_, half_v_;
  std::vector<Level> levels_;
};

/// The black and white squares, exactly integrated. Immutable; safe from any thread.
class BoardPattern {
 public:
  explicit BoardPattern(const BoardGeometry& board);

  /// Mean grey value over the patch of the plate around (a, b) [m], the centre being (0, 0), u along +x of frame B and
  /// v along -y. The patch is a box with the variance of a pixel's footprint.
  /// @param width_a, width_b  sides of the box [m]
  double gray(double a, double b, double width_a, double width_b) const;

  /// Whether the patch of half-sides (reach_a, reach_b) [m] touches no border between black and white.
  bool uniform(double a, double b, double reach_a, double reach_b) const;

 private:
  double columnOf(double a) const { return a / square_ + 0.5 * (cols_ - 1); }  // 0 at the origin corner
  double rowOf(double b) const { return -b / square_ + 0.5 * (rows_ - 1); }

  int cols_, rows_;
  double square_;
};

}  // namespace cocalib::sim
