#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
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
  static constexpr int kPadding = 2;  // texels repeated beyond the border, so that a look-up needs no bounds check

  struct Level {
    cv::Mat picture;           // CV_8UC1, padded
    float per_u, per_v;        // texels per metre
    float first_u, first_v;    // texel index of a = 0, b = 0
    const std::uint8_t* data;  // of picture
    std::ptrdiff_t step;
    // Interpolated between four texels. (a, b) must lie on the rectangle, give or take a texel.
    float at(float a, float b) const {
      const float x = a * per_u + first_u, y = b * per_v + first_v;
      const int ix = static_cast<int>(x), iy = static_cast<int>(y);
      const float fx = x - static_cast<float>(ix), fy = y - static_cast<float>(iy);
      const std::uint8_t* p = data + iy * step + ix;
      const std::uint8_t* q = p + step;
      const float top = p[0] + fx * (p[1] - p[0]);
      const float bottom = q[0] + fx * (q[1] - q[0]);
      return top + fy * (bottom - top);
    }
  };
  float half_u_, half_v_;
  std::vector<Level> levels_;
};

inline float Texture::gray(float a, float b, float level) const {
  a = std::clamp(a, -half_u_, half_u_);
  b = std::clamp(b, -half_v_, half_v_);
  const int base = static_cast<int>(level);
  const float fine = levels_[base].at(a, b);
  const float coarse = levels_[base + 1].at(a, b);
  return fine + (level - static_cast<float>(base)) * (coarse - fine);
}

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
