#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "cocalib/lidar/board_segmenter.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// A flat patch of a sweep that may be the chessboard, in numbers that need no sweep.
struct LidarPlate {
  Plane plane_L;                                       ///< normal pointing away from the lidar
  Eigen::Vector3d centre_L = Eigen::Vector3d::Zero();  ///< middle of the plate
  std::vector<Eigen::Vector3d> points_L;               ///< returns from the plate
  std::vector<Eigen::Vector3d>
      edge_bearings_L;  ///< unit; where rows cross the outline: between the last beam on the plate and the next
  double edge_spacing_rad = 0.0;  ///< mean angle between these two beams
};

/// @param points_L  the points that findBoardCandidates() was given
LidarPlate makeLidarPlate(const LidarScan& scan, const std::vector<Eigen::Vector3f>& points_L,
                          const BoardCandidate& candidate);

/// The board at one standstill: its pose from the picture and all that may be it in the sweep.
struct BoardView {
  Pose T_C_B;
  std::vector<LidarPlate> plates;
};

struct LidarCameraInitializerParams {
  double range_noise_m = 0.03;
  double max_normal_angle_rad = 0.12;  ///< between the camera's and the lidar's board, to call them the same
  double max_centre_distance_m = 0.2;
  double min_normal_spread_rad = 0.08;  ///< RMS tilt of the board about the direction in which it was tilted less
  bool estimate_range_bias = false;     ///< constant error of all ranges, a nuisance of some sensors
};

/// What the lidar-camera start finds.
struct LidarCameraStart {
  struct View {
    int plate = -1;                 ///< index in BoardView::plates of the one that is the board; -1: none
    double normal_angle_rad = 0.0;  ///< between camera's and lidar's board normals
    double centre_distance_m = 0.0;
  };
  Pose T_lidar_camera;
  Pose closed_form_T_lidar_camera;    ///< before the refinement
  double range_bias_m = 0.0;          ///< to be added to measured ranges; 0 unless estimated
  double plane_rms_m = 0.0;           ///< distance of the lidar's points to the camera's board
  double edge_rms_m = 0.0;            ///< of the outline crossings to the camera's plate
  Vector6d sigma = Vector6d::Zero();  ///< over T_lidar_camera's tangent [m, rad]; delete-one jackknife over the views
  int used_views = 0;
  std::vector<View> views;  ///< one per input view
};

/// Transform between lidar and camera from boards that both see, without any guess and without an IMU.
///
/// Which plate of each sweep is the board is decided by consensus: every pair of views with a plate of each makes a
/// hypothesis (rotation from two normals and the line between the middles), which the other views confirm or not.
/// From the consensus follow the rotation that aligns the normals (Arun et al., PAMI 1987) and the translation that
/// meets plane offsets and middles (linear). Then all points and outline crossings are fitted to the camera's boards.
/// Half-turned boards are the same to it. Deterministic.
///
/// @return nothing while fewer than three views with well-spread tilts agree; `reason` then says what is missing
std::optional<LidarCameraStart> initializeLidarCamera(const std::vector<BoardView>& views, const BoardGeometry& board,
                                                      const LidarCameraInitializerParams& params,
                                                      std::string* reason = nullptr);

}  // namespace cocalib
