#include "world_motion.h"

#include <algorithm>

namespace cocalib {

WorldMotion::WorldMotion(const std::vector<NavState>& nodes, const WindowState& state, const WindowState& base) {
  using Layout = GlobalLayout;
  const Pose A = nodes.front().T_W_I * base.nodes.front().T_W_I.inverse();
  A_inverse_ = A.inverse();
  Q_t_ = A_inverse_.R();
  theta_ = logSo3(A.q);
  J_theta_ = inverseLeftJacobianSo3(theta_);
  first_now_ = nodes.front().T_W_I.t;
  first_base_ = base.nodes.front().T_W_I.t;
  shift_ = first_now_ - first_base_ - theta_.cross(first_base_);

  const auto global = 15 * static_cast<Eigen::Index>(nodes.size());
  const auto planes = static_cast<int>(std::min(state.planes.size(), base.planes.size()));
  const Eigen::Index size = global + Layout::size(planes);
  d_ = Eigen::VectorXd::Zero(size);
  U_.setZero(size, 6);
  for (std::size_t i = 0; i < nodes.size(); ++i) {
    addNode(15 * static_cast<Eigen::Index>(i), nodes[i], base.nodes[i]);
  }
  // Mountings, gravity's magnitude and the plate's size are the same wherever the world stands.
  d_.tail(Layout::size(planes)) = globalMinus(state, base).head(Layout::size(planes));
  addPose(global + Layout::kBoard, state.T_W_B, base.T_W_B);
  for (int i = 0; i < planes; ++i) {
    const auto k = static_cast<std::size_t>(i);
    addPlane(global + Layout::plane(i), state.planes[k], base.planes[k]);
  }
}

void WorldMotion::addPose(Eigen::Index at, const Pose& now, const Pose& base) {
  const Vector6d rest = (A_inverse_ * now).minus(base);
  d_.segment<3>(at) = shift_ + theta_.cross(base.t) + rest.head<3>();
  d_.segment<3>(at + 3) = theta_ + rest.tail<3>();
  blocks_.emplace_back(at, Q_t_);
  blocks_.emplace_back(at + 3, Q_t_);
  U_.block<3, 3>(at, 0) = Eigen::Matrix3d::Identity() - Q_t_;
  U_.block<3, 3>(at, 3) = Q_t_ * hat(now.t - first_now_) - hat(base.t - first_base_) * J_theta_;
  U_.block<3, 3>(at + 3, 3) = J_theta_ - Q_t_;
}

void WorldMotion::addNode(Eigen::Index at, const NavState& now, const NavState& base) {
  d_.segment<15>(at) = minus(now, base);
  addPose(at, now.T_W_I, base.T_W_I);
  d_.segment<3>(at + 6) = theta_.cross(base.v_W) + Q_t_ * now.v_W - base.v_W;
  blocks_.emplace_back(at + 6, Q_t_);
  U_.block<3, 3>(at + 6, 3) = Q_t_ * hat(now.v_W) - hat(base.v_W) * J_theta_;
}

void WorldMotion::addPlane(Eigen::Index at, const Plane& now, const Plane& base) {
  const Eigen::Matrix<double, 3, 2> B_now = planeBasis(now.normal), B_base = planeBasis(base.normal);
  // All places as seen from the anchor, about which the tangents turn.
  const Eigen::Vector3d first_now = first_now_ - base.anchor, first_base = first_base_ - base.anchor;
  const Eigen::Vector3d s = first_now - Q_t_.transpose() * first_base;  // where A takes the anchor
  const Plane moved = {Q_t_ * now.normal, -now.distance(base.anchor) - now.normal.dot(s)};
  const Eigen::Vector3d rest = minus(moved, {base.normal, -base.distance(base.anchor)});
  d_.segment<2>(at) = B_base.transpose() * theta_ + rest.head<2>();
  d_[at + 2] = base.normal.dot(shift_ + theta_.cross(base.anchor)) + rest[2];

  Eigen::Matrix3d D = Eigen::Matrix3d::Identity();
  // The two bases are functions of the normals and may differ by a quarter turn where the normals hardly do.
  D.topLeftCorner<2, 2>() = B_base.transpose() * Q_t_ * B_now;
  D.bottomLeftCorner<1, 2>() = -now.normal.cross(s).transpose() * B_now;
  blocks_.emplace_back(at, D);
  U_.block<2, 3>(at, 3) = B_base.transpose() * (J_theta_ - Q_t_);
  U_.block<1, 3>(at + 2, 0) = (base.normal - now.normal).transpose();
  U_.block<1, 3>(at + 2, 3) =
      now.normal.cross(s - first_now).transpose() - first_base.cross(base.normal).transpose() * J_theta_;
}

Eigen::MatrixXd WorldMotion::pullBack(const Eigen::MatrixXd& H) const {
  Eigen::MatrixXd HM = H;
  for (const auto& [at, D] : blocks_) HM.middleCols<3>(at) = H.middleCols<3>(at) * D;
  HM.leftCols<6>().noalias() += H * U_;
  Eigen::MatrixXd MHM = HM;
  for (const auto& [at, D] : blocks_) MHM.middleRows<3>(at) = D.transpose() * HM.middleRows<3>(at);
  MHM.topRows<6>().noalias() += U_.transpose() * HM;
  return MHM;
}

Eigen::VectorXd WorldMotion::pullBack(const Eigen::VectorXd& g) const {
  Eigen::VectorXd out = g;
  for (const auto& [at, D] : blocks_) out.segment<3>(at) = D.transpose() * g.segment<3>(at);
  out.head<6>().noalias() += U_.transpose() * g;
  return out;
}

}  // namespace cocalib
