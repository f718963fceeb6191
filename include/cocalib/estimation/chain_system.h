#pragma once

#include <Eigen/Core>
#include <map>
#include <vector>

#include "cocalib/factors/imu_factor.h"

namespace cocalib {

/// Gauss-Newton normal equations H d = -b of a chain of inertial states (15 each) and a dense set of globals
/// (calibration, gravity, board, planes): the shape of every estimator here. Nodes couple to near nodes and to all
/// globals.
///
/// Eliminating a node is a Schur complement on its neighbours and the globals; eliminating all of them leaves the
/// information of the globals, eliminating the oldest ones leaves the prior of marginalization. A general sparse solver
/// spends most of its time on rows; here measurements are summed into blocks before any factorisation.
/// Not thread-safe; two systems may be filled by two threads and added.
class ChainSystem {
 public:
  using RowBlock = Eigen::Matrix<double, 15, Eigen::Dynamic>;

  ChainSystem(int nodes, int globals);

  int nodes() const { return static_cast<int>(diagonal_.size()); }
  int globals() const { return static_cast<int>(b_global.size()); }

  Matrix15d& diagonal(int i) { return diagonal_[static_cast<std::size_t>(i)]; }
  /// Block H_ij, i < j; made on first use.
  Matrix15d& offDiagonal(int i, int j);
  RowBlock& coupling(int i) { return coupling_[static_cast<std::size_t>(i)]; }
  Vector15d& gradient(int i) { return gradient_[static_cast<std::size_t>(i)]; }

  Eigen::MatrixXd H_global;  ///< both triangles
  Eigen::VectorXd b_global;
  Eigen::VectorXd global_damping;              ///< what solve() adds to the diagonal of H_global; no information
  Vector15d node_damping = Vector15d::Zero();  ///< the same for every node's diagonal
  double cost = 0.0;  ///< half the sum of squared whitened residuals (robust ones by their loss)

  void add(const ChainSystem& other);  ///< of the same nodes and the first of the globals

  /// Step that lowers the cost.
  struct Step {
    std::vector<Vector15d> nodes;
    Eigen::VectorXd globals;
    double predicted_decrease = 0.0;
  };
  /// Levenberg-Marquardt step: H + lambda diag(H) + damping.
  /// @return false if a pivot is not positive or the step not finite
  bool solve(double lambda, Step* step) const;

  /// Information H and gradient b of the globals after all nodes are eliminated; false if a pivot is not positive.
  bool globalInformation(Eigen::MatrixXd* H, Eigen::VectorXd* b) const;

  /// Eliminates nodes [0, count) and returns what they say of the rest: a dense prior over the nodes in `kept` (numbers
  /// before the elimination) and the globals, ordered nodes first.
  struct Marginal {
    std::vector<int> kept;
    Eigen::MatrixXd H;
    Eigen::VectorXd b;
  };
  bool marginalizeFront(int count, Marginal* marginal) const;

 private:
  struct Elimination;
  bool eliminate(const std::vector<int>& order, double lambda, const Vector15d& damping, Elimination* out) const;
  /// Nodes with few neighbours first: states between feature frames cost little then.
  std::vector<int> eliminationOrder() const;

  std::vector<Matrix15d> diagonal_;
  std::vector<std::map<int, Matrix15d>> off_diagonal_;  // by column, columns above the row
  std::vector<RowBlock> coupling_;
  std::vector<Vector15d> gradient_;
};

}  // namespace cocalib
