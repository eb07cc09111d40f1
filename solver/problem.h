// What the solver minimises, and the algebra of one view.
//
// Cost = 1/2 sum_k rho(|r_k|^2) over residual blocks r_k, whitened. Unknowns are shared (columns 0 .. n-1) or private to a
// group; a group (one sample of a robot, one point of a bundle adjustment) sees only its own private unknowns and some
// shared columns, so the normal equations are an arrowhead:
//     [ P_1           Q_1 ] [dp_1]     [a_1]
//     [      P_2      Q_2 ] [dp_2] = - [a_2]
//     [ Q_1' Q_2' ..  C   ] [dx  ]     [b  ]
// A group's part of it is the Gram matrix of [J_private J_shared r] over its columns; that is all a problem must compute. Its private
// rows stay with the group, the rest is added to C and b.
//
// Within one view J = L M (see models/sensors/sensor.h): accumulate the small Gram matrix of [L r], then expand M' (L'L) M.
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <limits>
#include <vector>

#include "kernels.h"

namespace kincal {

using Eigen::MatrixXd;
using Eigen::VectorXd;

/// chi2: sum of squared whitened residuals; twice: twice the minimised cost, that is with the losses.
struct Cost {
  double twice = 0, chi2 = 0;
};

struct GroupShape {
  int private_size = 0;
  std::vector<int> columns;  // shared columns that the group touches, ascending
  int rows = 0;              // whitened residuals, priors of private unknowns included
  int size() const { return private_size + static_cast<int>(columns.size()); }
};

/// Where a group's part of the normal equations goes. Places 0 .. m - 1 are the group's shared columns, in order.
struct GroupEquations {
  double* rows;    // [P | Q | a], zero at first: private_size rows of size() + 1 numbers; of P the upper triangle counts
  int stride;      // between rows
  double* shared;  // C at places i >= j is added to shared[origin[row[j]] + row[i]]
  const std::ptrdiff_t* origin;
  const int* row;
  double* gradient;  // b at place i is added to gradient[row[i]]
};

/// A nonlinear least-squares problem in groups. The state is one vector that only the problem understands. Calls for different
/// workers may run at the same time; `worker` selects scratch space. None of these may depend on the number of workers.
class Problem {
 public:
  virtual ~Problem() = default;
  virtual int shared_size() const = 0;
  virtual const std::vector<GroupShape>& groups() const = 0;
  /// Scratch for workers 0 .. count - 1.
  virtual void set_workers(int count) = 0;

  /// Called once before linearise() or square_root() of all groups at this state: what groups share is computed here.
  virtual void prepare(const VectorXd& state) = 0;
  /// Cost of a group; false where a residual is undefined.
  virtual bool evaluate(int group, const VectorXd& state, int worker, Cost& cost) const = 0;
  /// Adds the Gram matrix of [J_private J_touched r], weighted by the losses' slopes, to the normal equations.
  virtual bool linearise(int group, const VectorXd& state, int worker, const GroupEquations& to, Cost& cost) const = 0;
  /// A square root of the same: rows A with A'A = gram, computed from the residuals without squaring anything (QR of each view).
  virtual bool square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const = 0;
  /// For problems of very many tiny groups. evaluate() of groups first .. last - 1, summed.
  virtual bool evaluate_range(int first, int last, const VectorXd& state, int worker, Cost& cost) const {
    Cost one;
    for (int g = first; g < last; ++g) {
      if (!evaluate(g, state, worker, one)) return false;
      cost.twice += one.twice;
      cost.chi2 += one.chi2;
    }
    return true;
  }
  /// linearise() of these groups, at most kRange of them, follows: what can be computed for several at once is computed here.
  virtual void approach(int /*first*/, int /*last*/, const VectorXd& /*state*/, int /*worker*/) const {}
  static constexpr int kRange = 64;
  /// True: shared columns that stand together (of one camera) meet others only through privates, so that linearise() writes only the
  /// blocks of C on its diagonal; and linearising again is cheaper than keeping the groups' rows.
  virtual bool light() const { return false; }
  /// Light problems: [P | a | a + Q dx] of groups first .. last - 1 (at most kRange) to `rows`, group after group private_size rows of
  /// private_size + 2 numbers, upper triangle of P; they have slack behind them.
  virtual void condense(int /*first*/, int /*last*/, const VectorXd& /*state*/, const VectorXd& /*shared_step*/, int /*worker*/,
                        double* /*rows*/) const {}
  /// state moved by a step; privates stand group after group in `private_step`.
  virtual void retract(const VectorXd& state, const VectorXd& shared_step, const VectorXd& private_step, VectorXd& moved) const = 0;
  /// Evaluates covariances that depend on the state at this one and holds them from then on; false if there are none.
  virtual bool renew(const VectorXd& state) = 0;
};

/// One view's M: dense kinematic columns for the first rows of L, and single columns of L that are unknowns themselves. Both stand in
/// the order of their places in the group (private unknowns first, then touched columns); own ones are shared.
struct ViewColumns {
  std::vector<int> kinematic;            // place of each column of M
  std::vector<std::pair<int, int>> own;  // (column of L, place)
};

using RowMatrix = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

/// Scratch of expand(): sized once for the largest view, so that nothing is allocated later.
struct ExpandScratch {
  MatrixXd gram;                       // of [L r]
  RowMatrix m;                         // in its top left corner: M
  std::vector<double> product, block;  // row-major, `stride` apart: G M and M' G M
  std::vector<int> column;             // shared column of each column of M
  int stride = 0;

  /// width: columns of L; depth: rows of M; columns: of M.
  void reserve(int width, int depth, int columns) {
    gram.resize(width + 1, width + 1);
    stride = padded(columns) + kSlack;
    m.setZero(depth, stride);
    product.assign(static_cast<size_t>(width + 1) * stride, 0.0);
    block.assign(static_cast<size_t>(columns) * stride, 0.0);
    column.resize(columns);
  }
};

/// Where L M is a sum of parts that cancel (a rotation about a point of the target itself), rounding leaves 1e-16 of the parts, not 0:
/// a column of at most this share of the parts' squared norms is nothing.
constexpr double kCancelled = 1e-14;

/// Adds M' G M to the equations of a group of `k` private unknowns and `size` in all: `gram` in the scratch is the Gram matrix of [L r]
/// (width + 1 squared, both triangles), `m` the kinematic part of M (its first `depth` rows). Does not allocate.
inline void expand(int width, int depth, const ViewColumns& columns, int k, int size, ExpandScratch& s, const GroupEquations& to) {
  const int kin = static_cast<int>(columns.kinematic.size()), ld = static_cast<int>(s.gram.outerStride()), stride = s.stride;
  const double* g = s.gram.data();
  const int* place = columns.kinematic.data();
  kernels().expand(g, ld, width + 1, s.m.data(), stride, depth, kin, s.product.data(), s.block.data(), stride);
  int own_rows = 0;  // columns of M that are private
  while (own_rows < kin && place[own_rows] < k) ++own_rows;
  for (int j = 0; j < kin; ++j) {
    double* row = s.block.data() + static_cast<size_t>(j) * stride;
    double parts = 0;
    for (int r = 0; r < depth; ++r) parts += g[r + static_cast<size_t>(r) * ld] * s.m(r, j) * s.m(r, j);
    if (row[j] > kCancelled * parts) continue;
    for (int i = 0; i < kin; ++i) row[i] = s.block[static_cast<size_t>(i) * stride + j] = 0;
    for (int i = 0; i <= width; ++i) s.product[static_cast<size_t>(i) * stride + j] = 0;
  }
  for (int j = own_rows; j < kin; ++j) s.column[j] = to.row[place[j] - k];
  const int* shared = s.column.data();
  for (int j = 0; j < kin; ++j) {
    const double* from = s.block.data() + static_cast<size_t>(j) * stride;
    if (j < own_rows) {
      double* row = to.rows + static_cast<std::ptrdiff_t>(place[j]) * to.stride;
#pragma GCC unroll 8
      for (int i = j; i < kin; ++i) row[place[i]] += from[i];
    } else {
      double* column = to.shared + to.origin[s.column[j]];
#pragma GCC unroll 8
      for (int i = j; i < kin; ++i) column[shared[i]] += from[i];
    }
  }
  const double* last = s.product.data() + static_cast<size_t>(width) * stride;  // of the residual
  for (int j = 0; j < own_rows; ++j) to.rows[static_cast<std::ptrdiff_t>(place[j]) * to.stride + size] += last[j];
  for (int j = own_rows; j < kin; ++j) to.gradient[s.column[j]] += last[j];
  for (const auto& own : columns.own) {
    const double* from = s.product.data() + static_cast<size_t>(own.first) * stride;
    const int column = to.row[own.second - k];
    int j = 0;
#pragma GCC unroll 4
    for (; j < own_rows; ++j) to.rows[static_cast<std::ptrdiff_t>(place[j]) * to.stride + own.second] += from[j];
    for (; j < kin && place[j] < own.second; ++j) to.shared[to.origin[s.column[j]] + column] += from[j];
    double* below = to.shared + to.origin[column];
#pragma GCC unroll 4
    for (; j < kin; ++j) below[shared[j]] += from[j];
    const double* g_own = g + static_cast<size_t>(own.first) * ld;
    for (const auto& other : columns.own)
      if (other.second >= own.second) below[to.row[other.second - k]] += g_own[other.first];
    to.gradient[column] += g_own[width];
  }
}

}  // namespace kincal
