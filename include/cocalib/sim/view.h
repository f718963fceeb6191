#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

#include "cocalib/sim/scene.h"

namespace cocalib::sim {

/// The affine function f . (x, y, 1) of a ray (x, y, 1).
inline float affine(const Eigen::Vector3f& f, const Eigen::Vector2f& ray) {
  return f.x() * ray.x() + f.y() * ray.y() + f.z();
}

/// A rectangle as it is seen from one camera pose. With N . r = 1 / depth, the point of its plane on the ray
/// r = (x, y, 1) has the coordinates (A . r, B . r) / (N . r) [m] along the rectangle's u and v from its centre.
struct View {
  Eigen::Vector3f A, B, N;
  Eigen::Vector3f sides[4];  ///< all of them positive: the ray hits the rectangle
  int index = 0;             ///< of the rectangle

  /// Inverse depth [1/m] where the ray hits the rectangle, otherwise 0.
  float inverseDepth(const Eigen::Vector2f& ray) const {
    for (const Eigen::Vector3f& side : sides) {
      if (affine(side, ray) < 0.0F) return 0.0F;
    }
    const float w = affine(N, ray);
    return w > 0.0F ? w : 0.0F;
  }

  /// Where the ray meets the plane and how that changes with the pixel.
  struct Footprint {
    float a, b;         ///< [m]
    Eigen::Matrix2f J;  ///< d(a, b) / d(col, row) [m/px]
  };
  /// @param ray_step  change of the ray with the pixel: columns d/dcol, d/drow
  Footprint footprint(const Eigen::Vector2f& ray, const Eigen::Matrix2f& ray_step) const;
};
using Views = std::vector<const View*>;

/// The rectangles of a scene from one pose; those seen edge-on are left out.
std::vector<View> viewsFrom(const Scene& scene, const Pose& T_W_C);

/// Pixels [col, last_col) x [row, last_row) and the box of rays that holds them.
struct Tile {
  int col = 0, row = 0, last_col = 0, last_row = 0;
  Eigen::Vector2f center = Eigen::Vector2f::Zero(), half = Eigen::Vector2f::Zero();

  /// Extremes over the box of an affine function.
  float reach(const Eigen::Vector3f& f) const { return std::abs(f.x()) * half.x() + std::abs(f.y()) * half.y(); }
  float highest(const Eigen::Vector3f& f) const { return affine(f, center) + reach(f); }
  float lowest(const Eigen::Vector3f& f) const { return affine(f, center) - reach(f); }
};

/// Which rectangles may be seen within a tile.
struct TileContent {
  Views views;
  bool covered = false;  ///< there is one, and it fills the tile
};
TileContent contentOf(const Tile& tile, const std::vector<View>& views);

}  // namespace cocalib::sim
