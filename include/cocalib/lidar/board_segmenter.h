#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "cocalib/geometry/plane.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Outer size of the board's plate along x_B and y_B [m]: as the rig says, else one square more than the inner corners.
inline Eigen::Vector2d plateSize(const BoardGeometry& board) {
  return {board.width_m.value_or((board.cols + 1) * board.square_m),
          board.height_m.value_or((board.rows + 1) * board.square_m)};
}

/// Middle of the plate in B; the pattern stands in the middle of the plate.
inline Eigen::Vector3d plateCentre(const BoardGeometry& board) {
  return {0.5 * (board.cols - 1) * board.square_m, 0.5 * (board.rows - 1) * board.square_m, 0.0};
}

/// One crossing of a beam row over the board's outline: the last return on the board and the first beyond it.
struct BoardEdgeCrossing {
  int on_index = -1;                                           ///< index in the scan of the last point on the board
  Eigen::Vector3f beyond_bearing_L = Eigen::Vector3f::Zero();  ///< unit bearing of the first beam beyond
  float beyond_offset_s = 0.0F;                                ///< its time since the scan's stamp
};

/// The chessboard in one sweep.
struct BoardSegment {
  std::vector<int> points;                   ///< indices in the scan of the returns on the plate, away from its rim
  std::vector<BoardEdgeCrossing> crossings;  ///< empty for sensors without rings
  Plane plane_L;                             ///< fitted to the points (as deskewed by the caller)
};

/// Finds the plate of the board in a sweep, where it is predicted: never by a hand-drawn box.
///
/// @param points_L   the sweep's points, deskewed to one instant (same order and size as scan.points)
/// @param T_L_B      predicted pose of the board in the lidar frame at that instant (may be several cm and degrees off)
/// @param tolerance_m, tolerance_rad  1-sigma-like uncertainty of the prediction; the gate grows with it
/// @return nothing if no flat patch of about the plate's size stands there, or if two do
std::optional<BoardSegment> segmentBoard(const LidarScan& scan, const std::vector<Eigen::Vector3f>& points_L,
                                         const Pose& T_L_B, const BoardGeometry& board, double range_noise_m,
                                         double tolerance_m, double tolerance_rad);

/// Finds the plate without any prediction (static scenes, no calibration yet): every free-standing flat patch whose
/// extent fits the plate, best first. Used for the closed-form lidar-camera start.
struct BoardCandidate {
  BoardSegment segment;
  Eigen::Vector3d centre_L;  ///< middle of the plate
  Eigen::Vector3d normal_L;  ///< unit, pointing away from the lidar
  Eigen::Vector2d extent_m;  ///< measured along the longer and the shorter side
  double score = 0.0;        ///< 0..1
};
std::vector<BoardCandidate> findBoardCandidates(const LidarScan& scan, const std::vector<Eigen::Vector3f>& points_L,
                                                const BoardGeometry& board, double range_noise_m);

}  // namespace cocalib
