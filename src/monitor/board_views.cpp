#include "cocalib/monitor/board_views.h"

#include "cocalib/lidar/board_segmenter.h"
#include "cocalib/visual/board_detector.h"

namespace cocalib {
namespace {

// How far off the calibration may be for the plate to be found still: a start, not a result.
constexpr double kTolerance_m = 0.1, kTolerance_rad = 0.05;

}  // namespace

std::optional<BoardViews> viewBoard(const OverlayScene& scene, const BoardObservation& corners,
                                    const Calibration& calibration, const CameraModel& camera,
                                    const BoardGeometry& board, double range_noise_m) {
  const std::optional<Pose> T_C_B = estimateBoardPose(corners, board, camera);
  if (!T_C_B) return std::nullopt;
  BoardViews views;
  views.stamp = scene.image.stamp;
  views.T_C_B = *T_C_B;
  const std::vector<Eigen::Vector3d> points_C = pointsInCamera(scene, calibration);
  // The segmenter wants the sweep as the lidar would have seen it at the time of the picture.
  const Pose T_L_C = calibration.T_lidar_camera();
  std::vector<Eigen::Vector3f> points_L;
  points_L.reserve(points_C.size());
  for (const Eigen::Vector3d& p_C : points_C) points_L.push_back((T_L_C * p_C).cast<float>());
  const std::optional<BoardSegment> segment =
      segmentBoard(scene.scan, points_L, T_L_C * *T_C_B, board, range_noise_m, kTolerance_m, kTolerance_rad);
  if (!segment) return views;
  for (const int index : segment->points) views.plate_C.push_back(points_C[static_cast<std::size_t>(index)]);
  for (const BoardEdgeCrossing& crossing : segment->crossings) {
    if (crossing.on_index >= 0) views.rim_C.push_back(points_C[static_cast<std::size_t>(crossing.on_index)]);
  }
  return views;
}

}  // namespace cocalib
