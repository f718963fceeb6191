#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "cocalib/geometry/plane.h"
#include "cocalib/geometry/pose.h"
#include "cocalib/sim/scenario.h"

namespace cocalib::sim {

/// A flat rectangular surface in W, seen from the side its normal points to.
struct Rectangle {
  Eigen::Vector3d center, normal, u, v;  ///< u, v, normal: right-handed orthonormal axes
  double half_u = 0.0, half_v = 0.0;     ///< [m]
  bool is_board = false;

  Plane plane() const { return {normal, normal.dot(center)}; }
};

/// A 10 x 8 x 4 m room with a cupboard, a pillar and a leaning panel, or another Place, and the free-standing
/// chessboard.
/// Immutable; safe from any thread.
///
/// Frame B of the board: origin at the inner corner that is top left for somebody who stands upright before it, x to
/// the right along the columns, y down along the rows, z into the board. The square diagonally before the origin (its x
/// and y negative) is black. With 9 x 7 squares the picture is the same after half a turn; only "up" tells.
class Scene {
 public:
  explicit Scene(const Scenario& scenario);

  const std::vector<Rectangle>& rectangles() const { return rectangles_; }
  /// Index of the chessboard's front side, or -1 if the scenario has none.
  int boardIndex() const { return board_index_; }
  const Pose& T_W_B() const { return T_W_B_; }

  struct Hit {
    double range = 0.0;  ///< [m]
    int index = -1;      ///< of the rectangle
  };
  /// Nearest surface along a ray. @param direction unit length
  std::optional<Hit> raycast(const Eigen::Vector3d& origin, const Eigen::Vector3d& direction) const;

  /// Whether nothing stands between `eye` and a point that lies on a surface.
  bool visible(const Eigen::Vector3d& eye, const Eigen::Vector3d& point) const;

 private:
  std::vector<Rectangle> rectangles_;
  int board_index_ = -1;
  Pose T_W_B_;
};

/// Where the rig stands at rest: the middle of the motion in the room, the begin of the drive in the building [m].
inline Eigen::Vector3d restPosition() { return {4.2, 4.0, 1.7}; }

}  // namespace cocalib::sim
