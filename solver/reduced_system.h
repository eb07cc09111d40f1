// The reduced system S dx = -b of the shared unknowns: where its numbers are, and its factorisation.
//
// Dense: a full n x n array, lower triangle, Eigen's Cholesky. Sparse: the lower triangle in compressed columns over the union of
// the groups' column sets, CHOLMOD's simplicial Cholesky (LGPL; the supernodal module is GPL) with an AMD ordering, analysed once.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "problem.h"

namespace kincal {

enum class LinearSolver { automatic, dense, cholmod };

class ReducedSystem {
 public:
  /// Chooses and analyses. automatic: dense up to 400 unknowns or when more than 30 % of the entries are there.
  ReducedSystem(int n, const std::vector<GroupShape>& groups, LinearSolver choice);
  ~ReducedSystem();

  const char* name() const { return dense_ ? "dense" : "cholmod"; }
  /// Numbers of one accumulator (so that several workers can have one each).
  size_t storage() const { return dense_ ? static_cast<size_t>(n_) * n_ : row_of_.size(); }
  /// values += block (lower triangle, one row a touched column of the group).
  template <class Block>
  void add(int group, const Block& block, double* values) const {
    const std::vector<int>& columns = (*groups_)[group].columns;
    const Eigen::Index m = static_cast<Eigen::Index>(columns.size());
    const int* place = dense_ ? nullptr : places_[group].data();
    for (Eigen::Index j = 0; j < m; ++j)
      for (Eigen::Index i = j; i < m; ++i)
        values[dense_ ? columns[i] + static_cast<size_t>(columns[j]) * n_ : static_cast<size_t>(*place++)] += block(i, j);
  }
  double diagonal(const double* values, int i) const { return values[diagonal_place(i)]; }
  void add_diagonal(double* values, int i, double v) const { values[diagonal_place(i)] += v; }

  /// The whole matrix, both triangles.
  MatrixXd full(const double* values) const;

  /// False if the matrix is not positive definite to rounding.
  bool factor(const double* values);
  /// S x = b, in place.
  void solve(VectorXd& b);

 private:
  size_t diagonal_place(int i) const { return dense_ ? i + static_cast<size_t>(i) * n_ : static_cast<size_t>(column_start_[i]); }
  struct Sparse;

  int n_;
  bool dense_;
  const std::vector<GroupShape>* groups_;
  std::vector<int> column_start_, row_of_;      // lower triangle, compressed columns, diagonal first
  std::vector<std::vector<int>> places_;        // per group: place of each entry of its block, column by column
  MatrixXd factor_;
  std::unique_ptr<Sparse> sparse_;
};

}  // namespace kincal
