#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "cocalib/geometry/plane.h"
#include "cocalib/geometry/pose.h"
#include "cocalib/lidar/board_rectangle.h"
#include "cocalib/measurements/measurements.h"

/// The parts of which the board segmentation is made; users call cocalib/lidar/board_segmenter.h.
namespace cocalib::plate {

/// A sweep and its points brought to one instant.
struct Sweep {
  const LidarScan& scan;
  const std::vector<Eigen::Vector3f>& points_L;
  double range_noise_m;

  Eigen::Vector3d point(int index) const { return points_L[static_cast<std::size_t>(index)].cast<double>(); }
  const LidarPoint& raw(int index) const { return scan.points[static_cast<std::size_t>(index)]; }
  /// Distance from the plane within which a return counts as lying on it [m].
  double onGate() const { return 3.0 * range_noise_m + 0.005; }
  /// Distance behind the plane from which a return counts as having passed the plate [m].
  double offGate() const { return 4.0 * range_noise_m + 0.01; }
};

/// Plane through `origin_L` with axes u, v; a right-handed frame with `plane.normal`, which points away from the lidar.
struct PlaneFrame {
  Plane plane;
  Eigen::Vector3d origin_L = Eigen::Vector3d::Zero();
  Eigen::Vector3d u = Eigen::Vector3d::UnitX(), v = Eigen::Vector3d::UnitY();

  /// @param along  wished direction of u; nearly parallel to the normal: any
  PlaneFrame(const Plane& plane_L, const Eigen::Vector3d& near_L, const Eigen::Vector3d& along);
  Eigen::Vector2d coordinates(const Eigen::Vector3d& p_L) const {
    return {u.dot(p_L - origin_L), v.dot(p_L - origin_L)};
  }
  Eigen::Vector3d point(const Eigen::Vector2d& uv) const { return origin_L + uv.x() * u + uv.y() * v; }
};

/// What a beam says of the plane where it meets it.
enum class Verdict {
  kOn,       ///< returned from it
  kOff,      ///< went through: nothing is there
  kBlocked,  ///< returned from before it
  kUnclear,  ///< returned from so shortly behind it that noise or a mixed pixel may have done it
};

/// A beam near the patch.
struct Beam {
  int index = -1;                                 ///< in the scan
  double azimuth_rad = 0.0;                       ///< in the raw sensor frame, from the patch's middle
  Eigen::Vector2d hit = Eigen::Vector2d::Zero();  ///< where the beam meets the plane
  Verdict verdict = Verdict::kUnclear;
};

/// The beams of one ring near the patch, by azimuth.
struct Row {
  int ring = -1;
  std::vector<Beam> beams;
};

/// The beams that meet the plane within `radius_m` of the frame's origin, ring by ring; all of them in one row of
/// ring -1 where the sensor has no rings.
/// @param members  some returns from the patch: they tell where the sensor stood when it swept over it
std::vector<Row> beamsNear(const Sweep& sweep, const PlaneFrame& frame, const std::vector<int>& members,
                           double radius_m);

/// Angle between two neighbouring beams of a row: the median over `rows` [rad]; 0 if there are none.
double azimuthStep(const std::vector<Row>& rows);

/// A plate that was looked for in a plane.
struct Patch {
  PlaneFrame frame;
  Rectangle rectangle;  ///< of the plate's size, in the frame's coordinates
  std::vector<Row> rows;
  double step_m = 0.0;       ///< between neighbouring beams of a ring on the plane
  double gap_m = 0.0;        ///< between neighbouring rings on the plane
  std::vector<int> members;  ///< returns within the rectangle
  double misfit = 1.0;       ///< share of beams on the wrong side of the outline: 0 is perfect
};

/// Fits a rectangle of `size_m` to the patch in `plane` and decides whether it is the plate: filled, ending where
/// the plate ends on all sides, as large as the plate.
///
/// @param members   returns from the patch; the plane is refitted to those within the rectangle
/// @param start     pose of the rectangle in the plane, by its middle and the direction of its first side
/// @param any_roll  whether to try all directions of the first side, or only to refine the given one
std::optional<Patch> fitPatch(const Sweep& sweep, const Plane& plane, const std::vector<int>& members,
                              const Eigen::Vector3d& start_centre_L, const Eigen::Vector3d& start_side_L,
                              const Eigen::Vector2d& size_m, bool any_roll);

/// Rectangle whose size is free too, from the patch's own beams, longer side first. To tell the extent.
Rectangle measureRectangle(const Patch& patch);

/// Least-squares plane, normal away from the lidar; nothing if fewer than 3 points or all on a line.
std::optional<Plane> fitPlane(const Sweep& sweep, const std::vector<int>& indices);

/// Plane with most support among `indices` (RANSAC with fixed seed), refitted to what supports it.
/// @param towards    only planes whose normal is within `max_angle_rad` of it
/// @param supporters  where to put the indices within the gate
std::optional<Plane> findPlane(const Sweep& sweep, const std::vector<int>& indices, const Eigen::Vector3d& towards,
                               double max_angle_rad, int iterations, std::vector<int>* supporters);

}  // namespace cocalib::plate
