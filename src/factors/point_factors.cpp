#include "cocalib/factors/point_factors.h"

#include <cmath>

namespace cocalib {

std::optional<ReprojectionResidual> reprojection(const Pose& T_W_C, const Eigen::Vector3d& p_W,
                                                 const Eigen::Vector2d& px, double sigma_px,
                                                 const CameraModel& camera) {
  const Eigen::Matrix3d R_C_W = T_W_C.R().transpose();
  const Eigen::Vector3d ray_W = p_W - T_W_C.t;
  Eigen::Matrix<double, 2, 3> J_project;
  const auto projected = camera.project(R_C_W * ray_W, &J_project);
  if (!projected) return std::nullopt;

  ReprojectionResidual out;
  out.r = (*projected - px) / sigma_px;
  out.J_point = J_project * R_C_W / sigma_px;
  out.J_pose.leftCols<3>() = -out.J_point;
  // R <- Exp(e) R turns R^T a into R^T a + R^T hat(a) e.
  out.J_pose.rightCols<3>() = out.J_point * hat(ray_W);
  return out;
}

Eigen::Matrix<double, 3, 6> pointJacobian(const Pose& T_W_B, const Eigen::Vector3d& p_B) {
  Eigen::Matrix<double, 3, 6> J;
  J.leftCols<3>().setIdentity();
  J.rightCols<3>() = -hat(T_W_B.q * p_B);
  return J;
}

PlaneMomentResidual planeMoment(const Pose& T_W_L, const Plane& plane_W, const PlanePoints& points) {
  const Eigen::Matrix3d R_L_W = T_W_L.R().transpose();
  const Eigen::Vector3d& n = plane_W.normal;
  Eigen::Vector4d pi;
  pi << R_L_W * n, n.dot(T_W_L.t) - plane_W.offset_m;

  PlaneMomentResidual out;
  out.J_pose.setZero();
  out.J_pose.block<3, 3>(0, 3) = R_L_W * hat(n);
  out.J_pose.block<1, 3>(3, 0) = n.transpose();
  out.J_plane.setZero();
  out.J_plane.block<3, 3>(0, 0) = R_L_W;
  out.J_plane.block<1, 3>(3, 0) = T_W_L.t.transpose();
  out.J_plane(3, 3) = -1.0;
  out.S_pi = points.moment * pi;
  out.S_pi.head<3>() -= points.noise * pi.head<3>();
  out.cost = 0.5 * pi.dot(out.S_pi);
  out.H_pose = out.J_pose.transpose() * points.moment * out.J_pose;
  out.b_pose = out.J_pose.transpose() * out.S_pi;
  return out;
}

Eigen::Matrix<double, 4, 3> planeTangent(const Plane& plane_W) {
  Eigen::Matrix<double, 4, 3> J = Eigen::Matrix<double, 4, 3>::Zero();
  J.block<3, 2>(0, 0) = -hat(plane_W.normal) * planeBasis(plane_W.normal);
  J.block<1, 2>(3, 0) = plane_W.anchor.transpose() * J.block<3, 2>(0, 0);
  J(3, 2) = 1.0;
  return J;
}

Plane boardPlane(const Pose& T_W_B) {
  const Eigen::Vector3d n = T_W_B.q * Eigen::Vector3d::UnitZ();
  return {n, n.dot(T_W_B.t)};
}

Eigen::Matrix<double, 4, 6> boardPlaneTangent(const Pose& T_W_B) {
  const Eigen::Vector3d n = T_W_B.q * Eigen::Vector3d::UnitZ();
  Eigen::Matrix<double, 4, 6> J = Eigen::Matrix<double, 4, 6>::Zero();
  J.block<3, 3>(0, 3) = -hat(n);
  J.block<1, 3>(3, 0) = n.transpose();
  J.block<1, 3>(3, 3) = n.cross(T_W_B.t).transpose();  // (e x n).t = (n x t).e
  return J;
}

std::optional<BoardEdgeResidual> boardEdge(const Pose& T_W_L, const Pose& T_W_B, const Eigen::Vector3d& bearing_L,
                                           int axis, double edge_m, double sigma_m) {
  const Eigen::Matrix3d R_B_W = T_W_B.R().transpose();
  const Eigen::Vector3d origin_W = T_W_L.t - T_W_B.t;
  const Eigen::Vector3d ray_W = T_W_L.q * bearing_L;
  const Eigen::Vector3d n = R_B_W.row(2).transpose();
  const double slope = n.dot(ray_W);
  if (std::abs(slope) < 0.05) return std::nullopt;  // nearer than 3 degrees to the board's plane
  const double range = -n.dot(origin_W) / slope;
  const Eigen::Vector3d hit_W = origin_W + range * ray_W;
  const Eigen::Vector3d a = R_B_W.row(axis).transpose();

  // Moving the plane point or turning the ray slides the hit within the plane: project along the ray.
  const Eigen::RowVector3d along = (a - a.dot(ray_W) / slope * n).transpose();
  BoardEdgeResidual out;
  out.r = (a.dot(hit_W) - edge_m) / sigma_m;
  out.J_pose << along, -(range * along * hat(ray_W));
  // In the board's frame the world moves the other way: dt_B = -dt, and a turn e takes the hit to hit - e x hit.
  out.J_board << -along, along * hat(hit_W);
  out.J_pose /= sigma_m;
  out.J_board /= sigma_m;
  out.J_edge = -1.0 / sigma_m;
  return out;
}

}  // namespace cocalib
