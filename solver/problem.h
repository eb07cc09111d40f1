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
// Within one view J = L M (see models/sensor.h): accumulate the small Gram matrix of [L r], then expand M' (L'L) M.
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
  std::vector<int> columns;   // shared columns that the group touches, ascending
  int rows = 0;               // whitened residuals, priors of private unknowns included
  int size() const { return private_size + static_cast<int>(columns.size()); }
};

/// Where a group's part of the normal equations goes. Places 0 .. m - 1 are the group's shared columns, in order.
struct GroupEquations {
  double* rows;                  // [P | Q | a], zero at first: private_size rows of size() + 1 numbers; of P the lower triangle counts
  int stride;                    // between rows
  double* shared;                // C at places i >= j is added to shared[origin[row[j]] + row[i]]
  const std::ptrdiff_t* origin;
  const int* row;
  double* gradient;              // b at place i is added to gradient[row[i]]
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
  /// state moved by a step; privates stand group after group in `private_step`.
  virtual void retract(const VectorXd& state, const VectorXd& shared_step, const VectorXd& private_step, VectorXd& moved) const = 0;
  /// Evaluates covariances that depend on the state at this one and holds them from then on; false if there are none.
  virtual bool renew(const VectorXd& state) = 0;
};

/// One view's M: dense kinematic columns for the first rows of L, and single columns of L that are unknowns themselves.
struct ViewColumns {
  std::vector<int> kinematic;               // place of each column of M in the group: private unknowns first, then touched columns
  std::vector<std::pair<int, int>> own;     // (column of L, place in the group)
};

/// Scratch of expand(): sized once for the largest view, so that nothing is allocated later.
struct ExpandScratch {
  MatrixXd gram;                        // of [L r]
  std::vector<double> product, block;   // row-major, `stride` apart: G M; Gram matrix over the view's columns
  int stride = 0;
  std::vector<int> places;

  /// width: columns of L; columns: of M, own ones included.
  void reserve(int width, int columns) {
    gram.resize(width + 1, width + 1);
    stride = padded(columns + 1) + kSlack;
    product.assign(static_cast<size_t>(width + 1) * stride, 0.0);
    block.assign(static_cast<size_t>(columns + 1) * stride, 0.0);
    places.reserve(columns + 1);
  }
};

/// Where L M is a sum of parts that cancel (a rotation about a point of the target itself), rounding leaves 1e-16 of the parts, not 0:
/// a column of at most this share of the parts' squared norms is nothing.
constexpr double kCancelled = 1e-14;

/// Adds M' G M to the equations of a group of `k` private unknowns and `size` in all: `gram` in the scratch is the Gram matrix of [L r]
/// (width + 1 squared, both triangles), m the kinematic part of M (depth x columns.kinematic.size()). Does not allocate.
inline void expand(int width, const Eigen::Ref<const MatrixXd>& m, const ViewColumns& columns, int k, int size, ExpandScratch& s,
                   const GroupEquations& to) {
  const int depth = static_cast<int>(m.rows()), kin = static_cast<int>(m.cols()), own = static_cast<int>(columns.own.size());
  const int n = kin + own, ld = static_cast<int>(s.gram.outerStride());
  const double* g = s.gram.data();
  kernels().expand(g, ld, width + 1, m.data(), static_cast<int>(m.outerStride()), depth, kin, s.product.data(), s.block.data(), s.stride);
  const auto product = [&](int i, int j) -> double& { return s.product[static_cast<size_t>(i) * s.stride + j]; };
  const auto block = [&](int i) { return s.block.data() + static_cast<size_t>(i) * s.stride; };
  for (int i = 0; i < kin; ++i) {
    double parts = 0;
    for (int r = 0; r < depth; ++r) parts += g[r + static_cast<size_t>(r) * ld] * m(r, i) * m(r, i);
    if (block(i)[i] > kCancelled * parts) continue;
    for (int j = 0; j <= i; ++j) block(i)[j] = 0;
    for (int j = i; j < kin; ++j) block(j)[i] = 0;
    for (int j = 0; j <= width; ++j) product(j, i) = 0;
  }
  for (int i = 0; i <= own; ++i) {
    const int row = i < own ? columns.own[i].first : width;
    std::copy_n(&product(row, 0), kin, block(kin + i));
    for (int j = 0; j < own; ++j) block(kin + i)[kin + j] = g[row + static_cast<size_t>(columns.own[j].first) * ld];
  }
  s.places.assign(columns.kinematic.begin(), columns.kinematic.end());
  for (const auto& c : columns.own) s.places.push_back(c.second);
  for (int i = 0; i < n; ++i) {
    const int pi = s.places[i];
    for (int j = 0; j <= i; ++j) {
      const int low = std::min(pi, s.places[j]), high = std::max(pi, s.places[j]);
      if (low >= k)
        to.shared[to.origin[to.row[low - k]] + to.row[high - k]] += block(i)[j];
      else if (high >= k)
        to.rows[low * to.stride + high] += block(i)[j];
      else
        to.rows[high * to.stride + low] += block(i)[j];
    }
  }
  for (int j = 0; j < n; ++j) (s.places[j] < k ? to.rows[s.places[j] * to.stride + size] : to.gradient[to.row[s.places[j] - k]]) += block(n)[j];
}

}  // namespace kincal
