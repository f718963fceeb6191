#pragma once

#include <Eigen/Core>
#include <vector>

namespace cocalib::plate {

/// Rectangle in a plane: centre, rotation of its first side against the u axis, half lengths of its sides [m, rad].
struct Rectangle {
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double angle_rad = 0.0;
  Eigen::Vector2d half_m = Eigen::Vector2d::Zero();

  /// Coordinates of `p` in the rectangle's own axes, from its centre.
  Eigen::Vector2d local(const Eigen::Vector2d& p) const;
  /// Distance to the outline, negative inside; beyond a corner it is that to the nearer side's line.
  double signedDistance(const Eigen::Vector2d& p) const;
};

/// Moves `rectangle` until it parts what lies on the plate from what does not: minimises
///   sum_on softplus(sd / scale) + sum_off softplus(-sd / scale),
/// which is smooth, grows only linearly with an outlier's distance and, where a gap separates the two, puts the side
/// into the middle of the gap. Newton steps with the logistic's own curvature (iteratively re-weighted least squares).
///
/// @param fit_size  whether the side lengths are free too
/// @param scale_m   width of the transition
/// @return the minimum of the sum above
double fitRectangle(const std::vector<Eigen::Vector2d>& on, const std::vector<Eigen::Vector2d>& off, bool fit_size,
                    double scale_m, Rectangle* rectangle);

}  // namespace cocalib::plate
