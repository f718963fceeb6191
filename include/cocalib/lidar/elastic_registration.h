#pragma once

#include <Eigen/Core>
#include <array>
#include <vector>

#include "cocalib/geometry/pose.h"
#include "cocalib/lidar/planar_voxel_map.h"

namespace cocalib {

using Vector18d = Eigen::Matrix<double, 18, 1>;
using Matrix18d = Eigen::Matrix<double, 18, 18>;

/// Motion of the lidar over one sweep: constant twist between two poses plus a bow of constant acceleration.
/// T(a) = (begin o Exp-path to end)(a) plus 4 a (1 - a) bow, for a = 0..1 of the sweep.
struct SweepMotion {
  Pose begin, end;                  ///< T_M_L at the first and at the last point
  Vector6d bow = Vector6d::Zero();  ///< deviation at half time, in Pose's tangent

  Pose at(double fraction) const;
  /// Tangent velocity at the end, times the duration of the sweep.
  Vector6d endVelocity() const { return end.minus(begin) - 4.0 * bow; }
};

/// One point of a sweep, ready for registration.
struct SweepPoint {
  Eigen::Vector3d p_L;    ///< [m]
  double fraction = 0.0;  ///< of the sweep's duration, 0..1
};

/// A SweepMotion tabulated so finely that linear interpolation of the matrices errs by less than 1e-5.
class SampledMotion {
 public:
  explicit SampledMotion(const SweepMotion& motion);
  /// Where the point is in M.
  Eigen::Vector3d apply(const SweepPoint& point, Eigen::Vector3d* rotated = nullptr) const;

 private:
  static constexpr int kIntervals = 32;
  std::array<Eigen::Matrix3d, kIntervals + 1> R_;
  std::array<Eigen::Vector3d, kIntervals + 1> t_;
};

/// What is believed of the motion before its points are seen, as independent Gaussians over Pose's tangent.
struct MotionPrior {
  Pose begin;
  Vector6d begin_sigma = Vector6d::Ones();
  Vector6d begin_velocity = Vector6d::Zero();  ///< at the begin, times the duration
  Vector6d begin_velocity_sigma = Vector6d::Ones();
  Vector6d bow_sigma = Vector6d::Ones();  ///< about zero
};

struct ElasticRegistrationOptions {
  int max_iterations = 12;
  double point_sigma_m = 0.03;
  double first_gate_m = 0.5;  ///< distance to the map accepted in the first iteration
  double last_gate_m = 0.12;  ///< and at convergence
};

struct ElasticRegistrationResult {
  SweepMotion motion;
  double rms_m = 0.0;           ///< of the accepted distances
  double overlap = 0.0;         ///< accepted / given points
  double rotation_sigma = 1e9;  ///< worst direction of the sweep's rotation as the points alone determine it [rad]
  /// Covariance of its translation, the rotation being free [m^2]; metres along what the points leave open.
  Eigen::Matrix3d translation_covariance = 1e6 * Eigen::Matrix3d::Identity();
};

/// Finds the motion that lays the points of a sweep onto the map: Gauss-Newton over begin, end and bow with Tukey
/// weights, from coarse to fine gates, each iteration associating anew.
ElasticRegistrationResult registerElastic(const PlanarVoxelMap& map, const std::vector<SweepPoint>& points,
                                          const SweepMotion& start, const MotionPrior& prior,
                                          const ElasticRegistrationOptions& options);

}  // namespace cocalib
