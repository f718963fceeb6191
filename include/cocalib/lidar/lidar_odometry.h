#pragma once

#include <memory>

#include "cocalib/geometry/pose.h"
#include "cocalib/geometry/time.h"
#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Lidar odometry before anything is known of the mounting: each sweep is registered to a map of planar voxels with
/// a pose at its begin, one at its end and a bow between them (elastic, continuous-time within the sweep), so the
/// deskew comes out of the registration itself. Nothing is fed in but the points. Not thread-safe. Deterministic. Never
/// throws on data.
class LidarOdometry {
 public:
  struct Params {
    double voxel_m = 0.8;   ///< edge of the finest map voxel
    int max_points = 3000;  ///< points used of a sweep, spread evenly over it
    int max_iterations = 12;
    double range_noise_m = 0.03;  ///< 1 sigma
  };
  /// @throws std::invalid_argument if a parameter is not positive
  explicit LidarOdometry(const Params& params);
  ~LidarOdometry();

  /// Registration of one sweep in the odometry's own frame M (the lidar frame at the first sweep's begin).
  struct Result {
    TimeNs begin = 0, end = 0;  ///< first and last point, lidar clock
    Pose T_M_L_begin, T_M_L_end;
    Vector6d bow = Vector6d::Zero();  ///< deviation from constant velocity at half time, in Pose's tangent
    double rms_m = 0.0;               ///< of the accepted point-to-plane distances
    double overlap = 0.0;             ///< accepted / used points
    /// Whether the rotation can be relied on. Never for the first sweep (its motion is found with the second one's) and
    /// not when little of the sweep lies on the map or when its points leave a rotation axis open.
    bool good = false;
    /// The points lie on the map, whether or not they determine the whole rotation.
    bool registered = false;
    /// Projection onto the directions of M in which the points determine the position; a corridor leaves its own open.
    Eigen::Matrix3d seen_directions = Eigen::Matrix3d::Identity();
    /// Pose at a fraction of the sweep, 0 = begin, 1 = end.
    Pose at(double fraction) const;
  };
  /// Registers the next sweep. Sweeps come in order; when time jumps, call reset() first. An empty sweep, or one that
  /// cannot be registered, yields the prediction with good = false.
  Result addScan(const LidarScan& scan);

  /// Forgets the map and the motion.
  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cocalib
