#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <optional>
#include <vector>

namespace cocalib {

/// Unit bearings of the same points in two pictures a and b, entry by entry.
struct BearingPairs {
  std::vector<Eigen::Vector3d> a, b;
  std::size_t size() const { return a.size(); }
};

/// Motion between two pictures: p_b = R_b_a p_a + s t_b_a with unknown scale s.
struct TwoViewMotion {
  Eigen::Quaterniond R_b_a = Eigen::Quaterniond::Identity();
  Eigen::Vector3d t_b_a = Eigen::Vector3d::UnitZ();  ///< unit length
};

/// Distance of a pair from the epipolar constraint, to first order in the bearings' errors (Sampson's distance on the
/// sphere) [rad]: e / sqrt(|de/da|^2 + |de/db|^2) with e = b . (t x R a). Signed.
double epipolarError(const TwoViewMotion& motion, const Eigen::Vector3d& a, const Eigen::Vector3d& b);

/// Rotation alone that the most pairs obey (2-point RANSAC with a fixed seed), refined over all with a Cauchy loss.
/// @param threshold_rad  an inlier's largest angle between b and R a
std::optional<Eigen::Quaterniond> robustRotation(const BearingPairs& pairs, double threshold_rad);

/// Direction of translation that the most pairs obey under a known rotation (2-point RANSAC with a fixed seed).
/// @param threshold_rad  an inlier's largest |epipolarError()|
std::optional<TwoViewMotion> robustTranslation(const BearingPairs& pairs, const Eigen::Quaterniond& R_b_a,
                                               double threshold_rad);

/// Gauss-Newton over rotation and direction of translation with a Cauchy loss on epipolarError().
/// @param scale_rad  the loss's scale: about the error of a good pair
/// @param cost       where to put the robust cost (sum of log(1 + (r / scale)^2)), or null
TwoViewMotion refineMotion(const BearingPairs& pairs, const TwoViewMotion& start, double scale_rad,
                           double* cost = nullptr);

/// Pairs whose parallax runs against that of the majority: their points would lie behind the cameras. Tells the true
/// motion from its twin where the points lie nearly on one plane.
int depthConflicts(const BearingPairs& pairs, const TwoViewMotion& motion);

/// Motion by the five-point method (cv::findEssentialMat, RANSAC with OpenCV's fixed seed); pairs beyond 84 deg from
/// either optical axis do not take part.
std::optional<TwoViewMotion> essentialMotion(const BearingPairs& pairs, double threshold_rad);

}  // namespace cocalib
