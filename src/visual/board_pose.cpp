#include "cocalib/visual/board_pose.h"

#include <Eigen/Cholesky>
#include <Eigen/SVD>
#include <algorithm>
#include <cmath>
#include <opencv2/calib3d.hpp>

#include "cocalib/visual/board_detector.h"

namespace cocalib {
namespace {

/// Pose from the homography that takes board coordinates to the plane z = 1 (Zhang 2000, section 3.1).
std::optional<Pose> poseFromHomography(const std::vector<cv::Point2d>& points_B,
                                       const std::vector<cv::Point2d>& points_z1) {
  const cv::Mat homography = cv::findHomography(points_B, points_z1, 0);
  if (homography.empty()) return std::nullopt;
  Eigen::Matrix3d H;
  for (int i = 0; i < 9; ++i) H(i / 3, i % 3) = homography.at<double>(i / 3, i % 3);
  const double scale = 2.0 / (H.col(0).norm() + H.col(1).norm());
  if (!std::isfinite(scale)) return std::nullopt;
  H *= H(2, 2) < 0.0 ? -scale : scale;  // the board's origin stands before the camera
  Eigen::Matrix3d R;
  R << H.col(0), H.col(1), H.col(0).cross(H.col(1));
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(R, Eigen::ComputeFullU | Eigen::ComputeFullV);
  R = svd.matrixU() * svd.matrixV().transpose();
  if (R.determinant() < 0.0) return std::nullopt;
  return Pose{Eigen::Quaterniond(R).normalized(), H.col(2)};
}

/// Half the squared reprojection error [px^2] with its normal equations; negative where a corner cannot be projected.
double linearize(const Pose& T_C_B, const std::vector<std::optional<Eigen::Vector2d>>& corners_px,
                 const BoardGeometry& board, const CameraModel& camera, Matrix6d* H, Vector6d* g) {
  double cost = 0.0;
  H->setZero();
  g->setZero();
  for (int i = 0; i < board.cornerCount(); ++i) {
    if (!corners_px[i]) continue;
    const Eigen::Vector3d rotated = T_C_B.q * board.corner(i);
    Eigen::Matrix<double, 2, 3> J_point;
    const auto px = camera.project(rotated + T_C_B.t, &J_point);
    if (!px) return -1.0;
    Eigen::Matrix<double, 2, 6> J;
    J << J_point, -J_point * hat(rotated);
    const Eigen::Vector2d r = *corners_px[i] - *px;
    *H += J.transpose() * J;
    *g += J.transpose() * r;
    cost += 0.5 * r.squaredNorm();
  }
  return cost;
}

}  // namespace

std::optional<Pose> refineBoardPose(const Pose& start_T_C_B,
                                    const std::vector<std::optional<Eigen::Vector2d>>& corners_px,
                                    const BoardGeometry& board, const CameraModel& camera, double* rms_px) {
  const auto count = std::count_if(corners_px.begin(), corners_px.end(), [](const auto& px) { return px.has_value(); });
  if (count < 4 || static_cast<int>(corners_px.size()) != board.cornerCount()) return std::nullopt;
  Pose T_C_B = start_T_C_B;
  Matrix6d H, H_next;
  Vector6d g, g_next;
  double cost = linearize(T_C_B, corners_px, board, camera, &H, &g);
  if (cost < 0.0) return std::nullopt;
  double damping = 1e-6;  // Levenberg-Marquardt
  for (int i = 0; i < 20 && damping < 1e3; ++i) {
    Matrix6d damped = H;
    damped.diagonal() *= 1.0 + damping;
    const Vector6d step = damped.ldlt().solve(g);
    if (!step.allFinite()) return std::nullopt;
    const Pose next = T_C_B.plus(step);
    const double next_cost = linearize(next, corners_px, board, camera, &H_next, &g_next);
    if (next_cost < 0.0 || next_cost > cost) {
      damping *= 10.0;
      continue;
    }
    const bool converged = cost - next_cost <= 1e-9 * cost;
    T_C_B = next;
    cost = next_cost;
    H = H_next;
    g = g_next;
    damping = std::max(0.1 * damping, 1e-9);
    if (converged) break;
  }
  if (rms_px != nullptr) *rms_px = std::sqrt(2.0 * cost / static_cast<double>(count));
  return T_C_B;
}

std::optional<Pose> estimateBoardPose(const BoardObservation& observation, const BoardGeometry& board,
                                      const CameraModel& camera, double* rms_px) {
  const int count = board.cornerCount();
  if (count < 4 || static_cast<int>(observation.corners_px.size()) != count) return std::nullopt;
  // Bearings turned so that the board's middle lies on the axis: a wide lens may see corners at 90 deg and more.
  std::vector<Eigen::Vector3d> bearings;
  std::vector<std::optional<Eigen::Vector2d>> corners_px;
  Eigen::Vector3d middle = Eigen::Vector3d::Zero();
  for (const Eigen::Vector2f& px : observation.corners_px) {
    const auto bearing = camera.unproject(px.cast<double>());
    if (!bearing) return std::nullopt;
    bearings.push_back(*bearing);
    corners_px.emplace_back(px.cast<double>());
    middle += *bearing;
  }
  const Eigen::Quaterniond R_V_C = Eigen::Quaterniond::FromTwoVectors(middle, Eigen::Vector3d::UnitZ());
  std::vector<cv::Point2d> points_B, points_z1;
  for (int i = 0; i < count; ++i) {
    const Eigen::Vector3d bearing_V = R_V_C * bearings[i];
    if (bearing_V.z() < 0.05) return std::nullopt;
    const Eigen::Vector3d corner = board.corner(i);
    points_B.emplace_back(corner.x(), corner.y());
    points_z1.emplace_back(bearing_V.x() / bearing_V.z(), bearing_V.y() / bearing_V.z());
  }
  const std::optional<Pose> T_V_B = poseFromHomography(points_B, points_z1);
  if (!T_V_B) return std::nullopt;
  return refineBoardPose(Pose{R_V_C.conjugate(), Eigen::Vector3d::Zero()} * *T_V_B, corners_px, board, camera, rms_px);
}

}  // namespace cocalib
