#include "cocalib/estimation/chain_system.h"

#include <Eigen/Cholesky>
#include <cmath>
#include <numeric>

namespace cocalib {
namespace {

// Rows of eliminated couplings are gathered and applied to the global block in one product of this many nodes:
// a rank-480 update runs at several times the speed of rank-15 ones.
constexpr int kNodesPerUpdate = 32;

constexpr double kPivotFloor = 1e-12;

}  // namespace

/// Working copy during an elimination, and what back-substitution needs.
struct ChainSystem::Elimination {
  struct Pivot {
    int node;
    Eigen::LLT<Matrix15d> llt;
    std::vector<std::pair<int, Matrix15d>> neighbours;  // L^-1 H_vn
    RowBlock globals;                                   // L^-1 H_vg
    Vector15d b;                                        // L^-1 b_v
  };
  std::vector<Matrix15d> diagonal;
  std::vector<std::map<int, Matrix15d>> rows;  // symmetric storage: rows[i][j] = H_ij for both i<j and i>j
  std::vector<RowBlock> coupling;
  std::vector<Vector15d> gradient;
  Eigen::MatrixXd H_global;
  Eigen::VectorXd b_global;
  std::vector<Pivot> pivots;
};

ChainSystem::ChainSystem(int nodes, int globals)
    : H_global(Eigen::MatrixXd::Zero(globals, globals)),
      b_global(Eigen::VectorXd::Zero(globals)),
      diagonal_(static_cast<std::size_t>(nodes), Matrix15d::Zero()),
      off_diagonal_(static_cast<std::size_t>(nodes)),
      coupling_(static_cast<std::size_t>(nodes), RowBlock::Zero(15, globals)),
      gradient_(static_cast<std::size_t>(nodes), Vector15d::Zero()) {}

Matrix15d& ChainSystem::offDiagonal(int i, int j) {
  return off_diagonal_[static_cast<std::size_t>(i)].try_emplace(j, Matrix15d::Zero()).first->second;
}

void ChainSystem::add(const ChainSystem& other) {
  for (std::size_t i = 0; i < diagonal_.size(); ++i) {
    diagonal_[i] += other.diagonal_[i];
    coupling_[i] += other.coupling_[i];
    gradient_[i] += other.gradient_[i];
    for (const auto& [j, block] : other.off_diagonal_[i]) offDiagonal(static_cast<int>(i), j) += block;
  }
  H_global += other.H_global;
  b_global += other.b_global;
  cost += other.cost;
}

std::vector<int> ChainSystem::eliminationOrder() const {
  // Nodes that couple only to their direct neighbours go first; the others, which carry tracks, in time order.
  std::vector<bool> wide(diagonal_.size(), false);
  for (int i = 0; i < nodes(); ++i) {
    for (const auto& entry : off_diagonal_[static_cast<std::size_t>(i)]) {
      if (entry.first <= i + 1) continue;
      wide[static_cast<std::size_t>(i)] = wide[static_cast<std::size_t>(entry.first)] = true;
    }
  }
  std::vector<int> order;
  order.reserve(diagonal_.size());
  for (int pass = 0; pass < 2; ++pass) {
    for (int i = 0; i < nodes(); ++i) {
      if (wide[static_cast<std::size_t>(i)] == (pass == 1)) order.push_back(i);
    }
  }
  return order;
}

bool ChainSystem::eliminate(const std::vector<int>& order, double lambda, Elimination* out) const {
  Elimination& e = *out;
  const Eigen::Index G = b_global.size();
  e.diagonal = diagonal_;
  e.coupling = coupling_;
  e.gradient = gradient_;
  e.H_global = H_global;
  e.b_global = b_global;
  e.rows.assign(diagonal_.size(), {});
  for (std::size_t i = 0; i < diagonal_.size(); ++i) {
    e.diagonal[i].diagonal() *= 1.0 + lambda;
    e.diagonal[i].diagonal().array() += kPivotFloor;
    for (const auto& [j, block] : off_diagonal_[i]) {
      e.rows[i][j] = block;
      e.rows[static_cast<std::size_t>(j)][static_cast<int>(i)] = block.transpose();
    }
  }
  e.H_global.diagonal() *= 1.0 + lambda;

  Eigen::MatrixXd stacked(15 * kNodesPerUpdate, G);
  Eigen::VectorXd stacked_b(15 * kNodesPerUpdate);
  Eigen::Index filled = 0;
  const auto applyStacked = [&] {
    if (filled == 0) return;
    const auto Y = stacked.topRows(filled);
    e.H_global.selfadjointView<Eigen::Lower>().rankUpdate(Y.transpose(), -1.0);
    e.b_global.noalias() -= Y.transpose() * stacked_b.head(filled);
    filled = 0;
  };

  e.pivots.reserve(order.size());
  for (const int v : order) {
    const auto iv = static_cast<std::size_t>(v);
    Elimination::Pivot pivot{v, Eigen::LLT<Matrix15d>(e.diagonal[iv]), {}, std::move(e.coupling[iv]), e.gradient[iv]};
    if (pivot.llt.info() != Eigen::Success) return false;
    pivot.llt.matrixL().solveInPlace(pivot.globals);
    pivot.llt.matrixL().solveInPlace(pivot.b);
    for (auto& [n, block] : e.rows[iv]) {
      pivot.llt.matrixL().solveInPlace(block);
      pivot.neighbours.emplace_back(n, block);
      e.rows[static_cast<std::size_t>(n)].erase(v);
    }
    e.rows[iv].clear();
    for (std::size_t a = 0; a < pivot.neighbours.size(); ++a) {
      const auto& [n, Y_n] = pivot.neighbours[a];
      const auto in = static_cast<std::size_t>(n);
      e.diagonal[in].noalias() -= Y_n.transpose() * Y_n;
      e.coupling[in].noalias() -= Y_n.transpose() * pivot.globals;
      e.gradient[in].noalias() -= Y_n.transpose() * pivot.b;
      for (std::size_t c = a + 1; c < pivot.neighbours.size(); ++c) {
        const auto& [m, Y_m] = pivot.neighbours[c];
        const auto im = static_cast<std::size_t>(m);
        const Matrix15d update = Y_n.transpose() * Y_m;
        e.rows[in].try_emplace(m, Matrix15d::Zero()).first->second -= update;
        e.rows[im].try_emplace(n, Matrix15d::Zero()).first->second -= update.transpose();
      }
    }
    stacked.middleRows(filled, 15) = pivot.globals;
    stacked_b.segment<15>(filled) = pivot.b;
    filled += 15;
    if (filled == stacked.rows()) applyStacked();
    e.pivots.push_back(std::move(pivot));
  }
  applyStacked();
  e.H_global.triangularView<Eigen::StrictlyUpper>() = e.H_global.transpose();
  return true;
}

bool ChainSystem::solve(double lambda, Step* step) const {
  Elimination e;
  if (!eliminate(eliminationOrder(), lambda, &e)) return false;
  const Eigen::LLT<Eigen::MatrixXd> llt(e.H_global);
  if (llt.info() != Eigen::Success) return false;
  step->globals = -llt.solve(e.b_global);
  step->nodes.assign(diagonal_.size(), Vector15d::Zero());
  for (auto pivot = e.pivots.rbegin(); pivot != e.pivots.rend(); ++pivot) {
    Vector15d rhs = -pivot->b - pivot->globals * step->globals;
    for (const auto& [n, Y_n] : pivot->neighbours) rhs.noalias() -= Y_n * step->nodes[static_cast<std::size_t>(n)];
    pivot->llt.matrixU().solveInPlace(rhs);
    step->nodes[static_cast<std::size_t>(pivot->node)] = rhs;
  }
  // For a Gauss-Newton step d = -H^-1 b the model falls by b.H^-1.b / 2 = -b.d / 2.
  double b_dot_d = b_global.dot(step->globals);
  for (std::size_t i = 0; i < gradient_.size(); ++i) b_dot_d += gradient_[i].dot(step->nodes[i]);
  step->predicted_decrease = -0.5 * b_dot_d;
  return std::isfinite(b_dot_d);
}

bool ChainSystem::globalInformation(Eigen::MatrixXd* H, Eigen::VectorXd* b) const {
  Elimination e;
  if (!eliminate(eliminationOrder(), 0.0, &e)) return false;
  *H = e.H_global;
  *b = e.b_global;
  return H->allFinite() && b->allFinite();
}

bool ChainSystem::marginalizeFront(int count, Marginal* marginal) const {
  std::vector<int> order(static_cast<std::size_t>(count));
  std::iota(order.begin(), order.end(), 0);
  Elimination e;
  if (!eliminate(order, 0.0, &e)) return false;

  // Only nodes that the eliminated ones touched are part of the prior; all other blocks are untouched copies.
  marginal->kept.clear();
  std::vector<bool> touched(diagonal_.size(), false);
  for (const auto& pivot : e.pivots) {
    for (const auto& neighbour : pivot.neighbours) touched[static_cast<std::size_t>(neighbour.first)] = true;
  }
  for (int i = count; i < nodes(); ++i) {
    if (touched[static_cast<std::size_t>(i)]) marginal->kept.push_back(i);
  }
  const auto K = static_cast<Eigen::Index>(marginal->kept.size());
  const Eigen::Index G = b_global.size();
  marginal->H = Eigen::MatrixXd::Zero(15 * K + G, 15 * K + G);
  marginal->b = Eigen::VectorXd::Zero(15 * K + G);
  for (Eigen::Index a = 0; a < K; ++a) {
    const auto ia = static_cast<std::size_t>(marginal->kept[static_cast<std::size_t>(a)]);
    marginal->H.block<15, 15>(15 * a, 15 * a) = e.diagonal[ia];
    marginal->H.block(15 * a, 15 * K, 15, G) = e.coupling[ia];
    marginal->H.block(15 * K, 15 * a, G, 15) = e.coupling[ia].transpose();
    marginal->b.segment<15>(15 * a) = e.gradient[ia];
    for (Eigen::Index c = 0; c < K; ++c) {
      const auto entry = e.rows[ia].find(marginal->kept[static_cast<std::size_t>(c)]);
      if (entry != e.rows[ia].end()) marginal->H.block<15, 15>(15 * a, 15 * c) = entry->second;
    }
  }
  marginal->H.bottomRightCorner(G, G) = e.H_global;
  marginal->b.tail(G) = e.b_global;
  return marginal->H.allFinite() && marginal->b.allFinite();
}

}  // namespace cocalib
