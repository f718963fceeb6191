#include "cocalib/estimation/chain_system.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numeric>

namespace cocalib {
namespace {

// Rows of eliminated couplings are gathered and applied to the global block in one product of this many nodes:
// a rank-480 update runs at several times the speed of rank-15 ones.
constexpr int kNodesPerUpdate = 32;

constexpr double kPivotFloor = 1e-12;

}  // namespace

/// Working copy during an elimination, and what back-substitution needs. Nodes stand in the order of their elimination,
/// those that stay after them.
struct ChainSystem::Elimination {
  struct Row {
    int node = -1;
    std::vector<int> columns;  // places of later nodes that this one couples to, ascending
    // H_vn of those, then the couplings to the globals, then the gradient: one product serves all of them. Times L^-1
    // once the node is eliminated.
    RowBlock data;
    Matrix15d diagonal;
    Eigen::LLT<Matrix15d> llt;

    Eigen::Index width() const { return 15 * static_cast<Eigen::Index>(columns.size()); }
  };
  std::vector<int> place;  // of each node
  std::vector<Row> rows;   // by place
  std::size_t count = 0;   // of them are eliminated
  Eigen::MatrixXd H_global;
  Eigen::VectorXd b_global;
  RowBlock product;

  /// Which nodes couple in the end.
  void findColumns(const ChainSystem& system, const std::vector<int>& order);
  void fill(const ChainSystem& system, double lambda, const Vector15d& damping);
  /// Takes what row `p`, times L^-1, says off the rows that it couples to.
  void update(std::size_t p);
};

void ChainSystem::Elimination::findColumns(const ChainSystem& system, const std::vector<int>& order) {
  const auto nodes = static_cast<std::size_t>(system.nodes());
  count = order.size();
  rows.resize(nodes);
  place.assign(nodes, -1);
  int next = 0;
  const auto append = [&](int node) {
    rows[static_cast<std::size_t>(next)].node = node;
    place[static_cast<std::size_t>(node)] = next++;
  };
  for (const int node : order) append(node);
  for (int node = 0; node < system.nodes(); ++node) {
    if (place[static_cast<std::size_t>(node)] < 0) append(node);
  }
  for (std::size_t i = 0; i < nodes; ++i) {
    for (const auto& entry : system.off_diagonal_[i]) {
      const auto [first, second] = std::minmax(place[i], place[static_cast<std::size_t>(entry.first)]);
      rows[static_cast<std::size_t>(first)].columns.push_back(second);
    }
  }
  for (Row& row : rows) std::sort(row.columns.begin(), row.columns.end());
  std::vector<int> merged;
  for (std::size_t p = 0; p < count; ++p) {
    const std::vector<int>& own = rows[p].columns;
    for (auto column = own.begin(); column != own.end(); ++column) {
      std::vector<int>& theirs = rows[static_cast<std::size_t>(*column)].columns;
      merged.clear();
      std::set_union(column + 1, own.end(), theirs.begin(), theirs.end(), std::back_inserter(merged));
      theirs = merged;
      // What is eliminated itself hands on to the others.
      if (static_cast<std::size_t>(*column) < count) break;
    }
  }
}

void ChainSystem::Elimination::fill(const ChainSystem& system, double lambda, const Vector15d& damping) {
  const Eigen::Index G = system.b_global.size();
  for (Row& row : rows) {
    const auto v = static_cast<std::size_t>(row.node);
    row.data.setZero(15, row.width() + G + 1);
    row.data.middleCols(row.width(), G) = system.coupling_[v];
    row.data.col(row.width() + G) = system.gradient_[v];
    row.diagonal = system.diagonal_[v];
    row.diagonal.diagonal() *= 1.0 + lambda;
    row.diagonal.diagonal().array() += kPivotFloor + damping.array();
  }
  for (std::size_t i = 0; i < place.size(); ++i) {
    for (const auto& [j, block] : system.off_diagonal_[i]) {
      const auto [first, second] = std::minmax(place[i], place[static_cast<std::size_t>(j)]);
      Row& row = rows[static_cast<std::size_t>(first)];
      const auto k = std::lower_bound(row.columns.begin(), row.columns.end(), second) - row.columns.begin();
      auto target = row.data.middleCols<15>(15 * k);
      if (first == place[i]) {
        target = block;
      } else {
        target = block.transpose();
      }
    }
  }
  H_global = system.H_global;
  b_global = system.b_global;
  H_global.diagonal() *= 1.0 + lambda;
}

void ChainSystem::Elimination::update(std::size_t p) {
  const Row& row = rows[p];
  const auto m = static_cast<Eigen::Index>(row.columns.size());
  for (Eigen::Index a = 0; a < m; ++a) {
    Row& target = rows[static_cast<std::size_t>(row.columns[static_cast<std::size_t>(a)])];
    const Eigen::Index wide = row.data.cols() - 15 * a, shared = wide - 15 * (m - a);
    auto part = product.leftCols(wide);
    part.noalias() = row.data.middleCols<15>(15 * a).transpose() * row.data.rightCols(wide);
    target.diagonal -= part.leftCols<15>();
    std::size_t k = 0;
    for (Eigen::Index c = a + 1; c < m; ++c) {
      while (target.columns[k] != row.columns[static_cast<std::size_t>(c)]) ++k;
      target.data.middleCols<15>(15 * static_cast<Eigen::Index>(k)) -= part.middleCols<15>(15 * (c - a));
    }
    target.data.rightCols(shared) -= part.rightCols(shared);
  }
}

ChainSystem::ChainSystem(int nodes, int globals)
    : H_global(Eigen::MatrixXd::Zero(globals, globals)),
      b_global(Eigen::VectorXd::Zero(globals)),
      global_damping(Eigen::VectorXd::Zero(globals)),
      diagonal_(static_cast<std::size_t>(nodes), Matrix15d::Zero()),
      off_diagonal_(static_cast<std::size_t>(nodes)),
      coupling_(static_cast<std::size_t>(nodes), RowBlock::Zero(15, globals)),
      gradient_(static_cast<std::size_t>(nodes), Vector15d::Zero()) {}

Matrix15d& ChainSystem::offDiagonal(int i, int j) {
  return off_diagonal_[static_cast<std::size_t>(i)].try_emplace(j, Matrix15d::Zero()).first->second;
}

void ChainSystem::add(const ChainSystem& other) {
  const Eigen::Index G = other.b_global.size();
  for (std::size_t i = 0; i < diagonal_.size(); ++i) {
    diagonal_[i] += other.diagonal_[i];
    coupling_[i].leftCols(G) += other.coupling_[i];
    gradient_[i] += other.gradient_[i];
    for (const auto& [j, block] : other.off_diagonal_[i]) offDiagonal(static_cast<int>(i), j) += block;
  }
  H_global.topLeftCorner(G, G) += other.H_global;
  b_global.head(G) += other.b_global;
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

bool ChainSystem::eliminate(const std::vector<int>& order, double lambda, const Vector15d& damping,
                            Elimination* out) const {
  Elimination& e = *out;
  const Eigen::Index G = b_global.size();
  e.findColumns(*this, order);
  e.fill(*this, lambda, damping);
  Eigen::Index widest = 0;
  for (const Elimination::Row& row : e.rows) widest = std::max(widest, row.data.cols());
  e.product.resize(15, widest);

  Eigen::MatrixXd stacked(15 * kNodesPerUpdate, G + 1);
  Eigen::Index filled = 0;
  const auto applyStacked = [&] {
    if (filled == 0) return;
    const auto Y = stacked.topLeftCorner(filled, G);
    e.H_global.selfadjointView<Eigen::Lower>().rankUpdate(Y.transpose(), -1.0);
    e.b_global.noalias() -= Y.transpose() * stacked.col(G).head(filled);
    filled = 0;
  };

  for (std::size_t p = 0; p < e.count; ++p) {
    Elimination::Row& row = e.rows[p];
    row.llt.compute(row.diagonal);
    if (row.llt.info() != Eigen::Success) return false;
    row.llt.matrixL().solveInPlace(row.data);
    e.update(p);
    stacked.middleRows(filled, 15) = row.data.rightCols(G + 1);
    filled += 15;
    if (filled == stacked.rows()) applyStacked();
  }
  applyStacked();
  e.H_global.triangularView<Eigen::StrictlyUpper>() = e.H_global.transpose();
  return true;
}

bool ChainSystem::solve(double lambda, Step* step) const {
  Elimination e;
  if (!eliminate(eliminationOrder(), lambda, node_damping, &e)) return false;
  e.H_global.diagonal() += global_damping;
  const Eigen::LLT<Eigen::MatrixXd> llt(e.H_global);
  if (llt.info() != Eigen::Success) return false;
  const Eigen::Index G = b_global.size();
  step->globals = -llt.solve(e.b_global);
  step->nodes.assign(diagonal_.size(), Vector15d::Zero());
  for (auto row = e.rows.rbegin(); row != e.rows.rend(); ++row) {
    Vector15d rhs = -row->data.col(row->width() + G);
    rhs.noalias() -= row->data.middleCols(row->width(), G) * step->globals;
    for (std::size_t k = 0; k < row->columns.size(); ++k) {
      const int node = e.rows[static_cast<std::size_t>(row->columns[k])].node;
      rhs.noalias() -=
          row->data.middleCols<15>(15 * static_cast<Eigen::Index>(k)) * step->nodes[static_cast<std::size_t>(node)];
    }
    row->llt.matrixU().solveInPlace(rhs);
    step->nodes[static_cast<std::size_t>(row->node)] = rhs;
  }
  // For a Gauss-Newton step d = -H^-1 b the model falls by b.H^-1.b / 2 = -b.d / 2.
  double b_dot_d = b_global.dot(step->globals);
  for (std::size_t i = 0; i < gradient_.size(); ++i) b_dot_d += gradient_[i].dot(step->nodes[i]);
  step->predicted_decrease = -0.5 * b_dot_d;
  return std::isfinite(b_dot_d);
}

bool ChainSystem::globalInformation(Eigen::MatrixXd* H, Eigen::VectorXd* b) const {
  Elimination e;
  if (!eliminate(eliminationOrder(), 0.0, Vector15d::Zero(), &e)) return false;
  *H = e.H_global;
  *b = e.b_global;
  return H->allFinite() && b->allFinite();
}

bool ChainSystem::marginalizeFront(int count, Marginal* marginal) const {
  std::vector<int> order(static_cast<std::size_t>(count));
  std::iota(order.begin(), order.end(), 0);
  Elimination e;
  if (!eliminate(order, 0.0, Vector15d::Zero(), &e)) return false;

  // Only nodes that the eliminated ones touched are part of the prior; all other blocks are untouched copies.
  const auto nodes_there = static_cast<std::size_t>(nodes());
  std::vector<Eigen::Index> index(nodes_there, -1);  // in the prior, by place
  for (std::size_t p = 0; p < e.count; ++p) {
    for (const int column : e.rows[p].columns) index[static_cast<std::size_t>(column)] = 0;
  }
  marginal->kept.clear();
  for (std::size_t p = e.count; p < nodes_there; ++p) {
    if (index[p] < 0) continue;
    index[p] = static_cast<Eigen::Index>(marginal->kept.size());
    marginal->kept.push_back(e.rows[p].node);
  }
  const auto K = static_cast<Eigen::Index>(marginal->kept.size());
  const Eigen::Index G = b_global.size();
  marginal->H = Eigen::MatrixXd::Zero(15 * K + G, 15 * K + G);
  marginal->b = Eigen::VectorXd::Zero(15 * K + G);
  for (std::size_t p = e.count; p < nodes_there; ++p) {
    const Elimination::Row& row = e.rows[p];
    if (index[p] < 0) continue;
    const Eigen::Index at = 15 * index[p];
    marginal->H.block<15, 15>(at, at) = row.diagonal;
    for (std::size_t k = 0; k < row.columns.size(); ++k) {
      const Eigen::Index other = index[static_cast<std::size_t>(row.columns[k])];
      if (other < 0) continue;
      const auto block = row.data.middleCols<15>(15 * static_cast<Eigen::Index>(k));
      marginal->H.block<15, 15>(at, 15 * other) = block;
      marginal->H.block<15, 15>(15 * other, at) = block.transpose();
    }
    marginal->H.block(at, 15 * K, 15, G) = row.data.middleCols(row.width(), G);
    marginal->H.block(15 * K, at, G, 15) = row.data.middleCols(row.width(), G).transpose();
    marginal->b.segment<15>(at) = row.data.col(row.width() + G);
  }
  marginal->H.bottomRightCorner(G, G) = e.H_global;
  marginal->b.tail(G) = e.b_global;
  return marginal->H.allFinite() && marginal->b.allFinite();
}

}  // namespace cocalib
