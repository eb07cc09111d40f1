// What the solver minimises, and the algebra of one view.
//
// Cost = 1/2 sum_k rho(|r_k|^2) over residual blocks r_k, whitened. Unknowns are shared (columns 0 .. n-1) or private to a
// group; a group (one sample of a robot, one point of a bundle adjustment) sees only its own private unknowns and some
// shared columns, so the normal equations are an arrowhead:
//     [ P_1           Q_1 ] [dp_1]     [a_1]
//     [      P_2      Q_2 ] [dp_2] = - [a_2]
//     [ Q_1' Q_2' ..  C   ] [dx  ]     [b  ]
// A group's part of it is the Gram matrix of [J_private J_shared r] over its columns; that is all a problem must compute.
//
// Within one view J = L M (see models/sensor.h): accumulate the small Gram matrix of [L r], then expand M' (L'L) M.
#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

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
  /// Adds the Gram matrix of [J_private J_touched r], weighted by the losses' slopes, to `gram` (size() + 1 squared; lower triangle).
  virtual bool linearise(int group, const VectorXd& state, int worker, Eigen::Ref<MatrixXd> gram, Cost& cost) const = 0;
  /// A square root of the same: rows A with A'A = gram, computed from the residuals without squaring anything (QR of each view).
  virtual bool square_root(int group, const VectorXd& state, int worker, MatrixXd& rows) const = 0;
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

/// Scratch of expand() and gram(): sized once for the largest view, so that nothing is allocated later.
struct ExpandScratch {
  MatrixXd gram, product, block;
  std::vector<int> places;

  /// width: columns of L; columns: of M, own ones included.
  void reserve(int width, int columns) {
    gram.resize(width + 1, width + 1);
    product.resize(width + 1, columns);
    block.resize(columns + 1, columns + 1);
    places.reserve(columns + 1);
  }
};

/// g = rows' rows (w x w, both triangles, leading dimension ld) of n rows of w numbers, `stride` apart. The hot loop of every view:
/// four rows at a time, so that each entry of g is loaded and stored once for four products.
inline void gram(const double* rows, int n, int w, int stride, double* __restrict g, int ld) {
  for (int j = 0; j < w; ++j)
    for (int i = 0; i <= j; ++i) g[i + static_cast<size_t>(j) * ld] = 0;
  int k = 0;
  for (; k + 4 <= n; k += 4) {
    const double *a = rows + static_cast<size_t>(k) * stride, *b = a + stride, *c = b + stride, *d = c + stride;
    for (int j = 0; j < w; ++j) {
      const double aj = a[j], bj = b[j], cj = c[j], dj = d[j];
      double* column = g + static_cast<size_t>(j) * ld;
      for (int i = 0; i <= j; ++i) column[i] += aj * a[i] + bj * b[i] + cj * c[i] + dj * d[i];
    }
  }
  for (; k < n; ++k) {
    const double* a = rows + static_cast<size_t>(k) * stride;
    for (int j = 0; j < w; ++j)
      for (int i = 0; i <= j; ++i) g[i + static_cast<size_t>(j) * ld] += a[j] * a[i];
  }
  for (int j = 0; j < w; ++j)
    for (int i = 0; i < j; ++i) g[j + static_cast<size_t>(i) * ld] = g[i + static_cast<size_t>(j) * ld];
}

/// Where L M is a sum of parts that cancel (a rotation about a point of the target itself), rounding leaves 1e-16 of the parts, not 0:
/// a column of at most this share of the parts' squared norms is nothing.
constexpr double kCancelled = 1e-14;

/// gram += M' G M on the lower triangle: `view_gram` is the Gram matrix of [L r] ((W + 1) squared, both triangles), `m` the
/// kinematic part of M (K x columns.kinematic.size()). The residual's place is the last one of `gram`. Does not allocate.
inline void expand(const Eigen::Ref<const MatrixXd>& view_gram, const Eigen::Ref<const MatrixXd>& m, const ViewColumns& columns,
                   ExpandScratch& s, Eigen::Ref<MatrixXd> gram) {
  const Eigen::Index k = m.rows(), kin = m.cols(), own = static_cast<Eigen::Index>(columns.own.size()), w = view_gram.rows() - 1;
  const Eigen::Index n = kin + own + 1;
  auto product = s.product.topLeftCorner(w + 1, kin);
  auto block = s.block.topLeftCorner(n, n);
  product.noalias() = view_gram.leftCols(k).lazyProduct(m);
  block.topLeftCorner(kin, kin).noalias() = m.transpose().lazyProduct(product.topRows(k));
  for (Eigen::Index i = 0; i < kin; ++i) {
    double parts = 0;
    for (Eigen::Index r = 0; r < k; ++r) parts += view_gram(r, r) * m(r, i) * m(r, i);
    if (block(i, i) > kCancelled * parts) continue;
    block.row(i).head(kin).setZero();
    block.col(i).head(kin).setZero();
    product.col(i).setZero();
  }
  for (Eigen::Index i = 0; i <= own; ++i) {
    const Eigen::Index row = i < own ? columns.own[i].first : w;
    for (Eigen::Index j = 0; j < kin; ++j) block(kin + i, j) = block(j, kin + i) = product(row, j);
    for (Eigen::Index j = 0; j <= i; ++j)
      block(kin + i, kin + j) = block(kin + j, kin + i) = view_gram(row, j < own ? columns.own[j].first : w);
  }
  s.places.assign(columns.kinematic.begin(), columns.kinematic.end());
  for (const auto& c : columns.own) s.places.push_back(c.second);
  s.places.push_back(static_cast<int>(gram.rows()) - 1);
  for (Eigen::Index j = 0; j < n; ++j) {
    const int pj = s.places[j];
    for (Eigen::Index i = 0; i < n; ++i)
      if (s.places[i] >= pj) gram(s.places[i], pj) += block(i, j);
  }
}

}  // namespace kincal
