#include "cocalib/estimation/marginal_prior.h"

#include <Eigen/Eigenvalues>
#include <utility>

#include "world_motion.h"

namespace cocalib {

MarginalPrior::MarginalPrior(ChainSystem::Marginal marginal, int dropped, const WindowState& state)
    : base_(state), H_(std::move(marginal.H)), b_(std::move(marginal.b)) {
  base_.nodes.clear();
  for (const int node : marginal.kept) {
    nodes_.push_back(node - dropped);
    base_.nodes.push_back(state.nodes[static_cast<std::size_t>(nodes_.back())]);
  }
}

void MarginalPrior::accumulate(const WindowState& state, ChainSystem* system) const {
  const auto K = static_cast<Eigen::Index>(nodes_.size());
  const Eigen::Index G = H_.rows() - 15 * K;
  std::vector<NavState> nodes;
  for (const int node : nodes_) nodes.push_back(state.nodes[static_cast<std::size_t>(node)]);
  const WorldMotion moved(nodes, state, base_);
  const Eigen::VectorXd& d = moved.difference();
  const Eigen::MatrixXd H = moved.pullBack(H_);
  const Eigen::VectorXd gradient = moved.pullBack(Eigen::VectorXd(H_ * d + b_));
  for (Eigen::Index a = 0; a < K; ++a) {
    const int i = nodes_[static_cast<std::size_t>(a)];
    system->diagonal(i) += H.block<15, 15>(15 * a, 15 * a);
    system->gradient(i) += gradient.segment<15>(15 * a);
    system->coupling(i).leftCols(G) += H.block(15 * a, 15 * K, 15, G);
    for (Eigen::Index c = a + 1; c < K; ++c) {
      system->offDiagonal(i, nodes_[static_cast<std::size_t>(c)]) += H.block<15, 15>(15 * a, 15 * c);
    }
  }
  system->H_global.topLeftCorner(G, G) += H.bottomRightCorner(G, G);
  system->b_global.head(G) += gradient.tail(G);
  system->cost += 0.5 * d.dot(H_ * d) + b_.dot(d);
}

void MarginalPrior::forgetPlane(int index) {
  const Eigen::Index at = 15 * static_cast<Eigen::Index>(nodes_.size()) + GlobalLayout::plane(index);
  if (at + 3 > H_.rows()) return;
  // A direction of which nothing is known but rounding has nothing to hand on, and no inverse.
  constexpr double kLeast = 1e-9;  // 1/m^2 or 1/rad^2
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> plane(H_.block<3, 3>(at, at));
  Eigen::Vector3d inverse = Eigen::Vector3d::Zero();
  for (int i = 0; i < 3; ++i) {
    if (plane.eigenvalues()[i] > kLeast) inverse[i] = 1.0 / plane.eigenvalues()[i];
  }
  const Eigen::Matrix3d P = plane.eigenvectors() * inverse.asDiagonal() * plane.eigenvectors().transpose();
  const Eigen::Matrix<double, Eigen::Dynamic, 3> columns = H_.middleCols<3>(at);
  const Eigen::Vector3d b_plane = b_.segment<3>(at);
  H_.noalias() -= columns * P * columns.transpose();
  b_.noalias() -= columns * (P * b_plane);
  H_.middleRows<3>(at).setZero();
  H_.middleCols<3>(at).setZero();
  b_.segment<3>(at).setZero();
}

void MarginalPrior::startPlane(int index, const Plane& plane) {
  const auto i = static_cast<std::size_t>(index);
  if (i < base_.planes.size()) base_.planes[i] = plane;
}

}  // namespace cocalib
