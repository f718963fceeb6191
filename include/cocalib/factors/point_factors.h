#pragma once

#include <Eigen/Core>
#include <optional>

#include "cocalib/geometry/plane.h"
#include "cocalib/geometry/pose.h"
#include "cocalib/sensors/camera_model.h"

namespace cocalib {

/// Camera factors against the pose of the camera: r = (project(T_W_C^-1 p_W) - px) / sigma.
struct ReprojectionResidual {
  Eigen::Vector2d r;
  Eigen::Matrix<double, 2, 6> J_pose;   ///< over T_W_C's tangent
  Eigen::Matrix<double, 2, 3> J_point;  ///< over p_W
};
/// @return nothing where the point does not project (behind the camera, folded lens)
std::optional<ReprojectionResidual> reprojection(const Pose& T_W_C, const Eigen::Vector3d& p_W,
                                                 const Eigen::Vector2d& px, double sigma_px, const CameraModel& camera);

/// d p_W / d T_W_B of a point that is fixed in B, p_W = T_W_B p_B.
Eigen::Matrix<double, 3, 6> pointJacobian(const Pose& T_W_B, const Eigen::Vector3d& p_B);

/// What a plane needs to know of many points: their moment, and what noise along the rays has added to it.
struct PlanePoints {
  Eigen::Matrix4d moment = Eigen::Matrix4d::Zero();  ///< S = sum w [p_L; 1][p_L; 1]^T
  Eigen::Matrix3d noise = Eigen::Matrix3d::Zero();   ///< N = sum w sigma^2 u u^T, with u the rays
};

/// Many lidar points on one plane, seen from one pose of the lidar (points of a few milliseconds, deskewed within):
/// with the moment S = sum w [p_L; 1][p_L; 1]^T and the plane in the lidar frame pi_L = [R^T n; n.t - d] the sum of
/// squared weighted distances is exactly pi_L^T S pi_L, so a thousand points cost what four do and none is lost.
///
/// A range too long by e puts its point e u away: not only off the plane but, in step with that, along it too, and the
/// gradient of the squared distances has a mean of N pi even at the truth. It turns planes and poses by many sigmas
/// when millions of points are summed, so cost and gradient are those of S - N, the true points' in expectation. The
/// Hessian stays that of S: where few points lie in a narrow strip S - N has negative directions.
struct PlaneMomentResidual {
  double cost = 0.0;  ///< pi^T (S - N) pi / 2
  Matrix6d H_pose;    ///< Gauss-Newton, over T_W_L's tangent
  Vector6d b_pose;
  Eigen::Matrix<double, 4, 6> J_pose;   ///< d pi_L / d T_W_L
  Eigen::Vector4d S_pi;                 ///< (S - N) pi_L
  Eigen::Matrix<double, 4, 4> J_plane;  ///< d pi_L / d (n, d) before any manifold is applied
};
PlaneMomentResidual planeMoment(const Pose& T_W_L, const Plane& plane_W, const PlanePoints& points);

/// d (n, d) / d tangent of a plane landmark: 4x3.
Eigen::Matrix<double, 4, 3> planeTangent(const Plane& plane_W);
/// The board's plane z_B = 0 in the world, and d (n, d) / d T_W_B: 4x6.
Plane boardPlane(const Pose& T_W_B);
Eigen::Matrix<double, 4, 6> boardPlaneTangent(const Pose& T_W_B);

/// A beam that crosses an edge of the plate: it meets the board's plane where the edge is,
/// r = (q_B[axis] - edge) / sigma with q_B = intersection of the beam with z_B = 0.
struct BoardEdgeResidual {
  double r;
  Eigen::Matrix<double, 1, 6> J_pose;   ///< over T_W_L's tangent
  Eigen::Matrix<double, 1, 6> J_board;  ///< over T_W_B's tangent
  double J_edge;
};
/// @param axis 0: edges at constant x_B, 1: at constant y_B. @return nothing if the beam is parallel to the board
std::optional<BoardEdgeResidual> boardEdge(const Pose& T_W_L, const Pose& T_W_B, const Eigen::Vector3d& bearing_L,
                                           int axis, double edge_m, double sigma_m);

}  // namespace cocalib
