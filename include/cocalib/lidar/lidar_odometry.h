#pragma once

#include <memory>
#include <optional>

#include "cocalib/measurements/measurements.h"

namespace cocalib {

/// Lidar odometry before anything is known of the mounting: each sweep is registered to a map of planar voxels with
/// a pose at its begin and one at its end (elastic, continuous-time within the sweep), so the deskew comes out of the
/// registration itself. Once a gyro rotation is known it can be given and only the translation stays elastic.
/// Not thread-safe. Deterministic.
class LidarOdometry {
 public:
  struct Params {
    double voxel_m = 0.8;          ///< edge of the finest map voxel
    int max_points = 3000;         ///< points used of a sweep, spread evenly over it
    int max_iterations = 12;
    double range_noise_m = 0.03;   ///< 1 sigma
  };
  explicit LidarOdometry(const Params& params);
  ~LidarOdometry();

  /// Registration of one sweep in the odometry's own frame M (the lidar frame at the first sweep's begin).
  struct Result {
    TimeNs begin = 0, end = 0;  ///< first and last point, lidar clock
    Pose T_M_L_begin, T_M_L_end;
    double rms_m = 0.0;         ///< of the accepted point-to-plane distances
    double overlap = 0.0;       ///< accepted / used points
    bool good = false;
    /// Pose at a fraction of the sweep, 0 = begin, 1 = end.
    Pose at(double fraction) const;
  };
  Result addScan(const LidarScan& scan);

  void reset();

 private:
  struct Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace cocalib
