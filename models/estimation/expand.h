// From the Gram matrix of one view to the normal equations of its group.
//
// Within one view J = L M (models/sensors/sensor.h), so J'J = M' G M with the small Gram matrix G
// of [L r], which is accumulated first. The unknowns of a view are of two kinds. Kinematic columns
// of M are dense in the first rows (those of the pose that the sensor sees) and differ from sample
// to sample. Own ones are single columns of L, or minus one: the sensor's numbers, and its pose as
// well, whose motion moves what is seen the other way round. With K the kinematic columns,
//     X = K' G   (kinematic by all columns of [L r])   and   K' G K = X K
// hold all products; those of own columns among themselves are G itself.
//
// Private unknowns have rows in each group. Of shared ones only sums count, and all views of one
// sensor along one path have the same of them: G, X and X K are added as they are, side by side in
// memory, for a whole piece of groups (SharedSums), and then go to their places in C and b once.
#pragma once

#include <algorithm>
#include <vector>

#include "../../solver/aligned.h"
#include "../../solver/kernels.h"
#include "../../solver/problem.h"
#include "../sensors/sensor.h"

namespace kincal {

/// An OwnColumn is an unknown that is `sign` times a column of L by itself.
struct OwnColumn {
  int column;  // of L
  int place;   // in the group, or the shared column
  double sign;
};

/// ViewColumns describes one view's M. Places are those in the group; private kinematic columns
/// come first, ascending. Own ones are shared.
struct ViewColumns {
  int width = 0;               // columns of L
  std::vector<int> kinematic;  // place of each
  std::vector<OwnColumn> own;
};

/// SharedColumns are those that views have in common.
struct SharedColumns {
  int width = 0;               // columns of L
  std::vector<int> kinematic;  // shared columns of the last columns of M
  std::vector<int> runs;       // by these: how many from there on are neighbours; empty: not known
  std::vector<OwnColumn> own;

  bool operator==(const SharedColumns& other) const {
    return width == other.width && kinematic == other.kinematic &&
           std::equal(own.begin(), own.end(), other.own.begin(), other.own.end(),
                      [](const OwnColumn& a, const OwnColumn& b) {
                        return a.column == b.column && a.place == b.place && a.sign == b.sign;
                      });
  }
  int kinematic_size() const { return static_cast<int>(kinematic.size()); }
  /// Returns the numbers of the sums below.
  size_t size() const {
    return static_cast<size_t>(width + 1 + kinematic_size()) * padded(width + 1) +
           static_cast<size_t>(kinematic_size()) * padded(kinematic_size());
  }
};

/// SharedSums are G, X and the upper triangle of X K, of one view or of many, row-major; X and X K
/// of shared columns only.
struct SharedSums {
  double *gram, *product, *block;
  int gram_stride, product_stride, block_stride;

  SharedSums(double* g, double* x, double* xk, int g_stride, int x_stride, int xk_stride)
      : gram(g),
        product(x),
        block(xk),
        gram_stride(g_stride),
        product_stride(x_stride),
        block_stride(xk_stride) {}
  /// In an array of columns.size() numbers.
  SharedSums(const SharedColumns& columns, double* at)
      : gram(at),
        product(gram + static_cast<size_t>(columns.width + 1) * padded(columns.width + 1)),
        block(product + static_cast<size_t>(columns.kinematic_size()) * padded(columns.width + 1)),
        gram_stride(padded(columns.width + 1)),
        product_stride(gram_stride),
        block_stride(padded(columns.kinematic_size())) {}
};

/// ExpandScratch is the scratch of expand(): it is sized once for the largest view, so that nothing
/// is allocated later.
struct ExpandScratch {
  MatrixXd gram;                  // of [L r]
  RowMatrix m;                    // in its top left corner: K
  AlignedNumbers product, block;  // X and X K, rows `product_stride` and `stride` apart
  std::vector<double> parts;      // squared norms of what each column of L K is a sum of
  SharedColumns columns;          // places of the view's
  int product_stride = 0, stride = 0;

  /// Makes room for `width` columns of L, `depth` rows of M and `columns` columns of M.
  void reserve(int width, int depth, int count) {
    gram.setZero(padded(width + 1), width + 1);
    product_stride = padded(width + 1);
    stride = padded(count) + kSlack;
    m.setZero(depth, stride);
    product.assign(static_cast<size_t>(count) * product_stride, 0.0);
    block.assign(static_cast<size_t>(count) * stride, 0.0);
    parts.resize(count);
    columns.kinematic.reserve(count);
    columns.own.reserve(count);
  }
};

/// Where L K is a sum of parts that cancel (a rotation about a point of the target itself),
/// rounding leaves 1e-16 of the parts, not 0: a column of at most this share of the parts' squared
/// norms is nothing.
constexpr double kCancelled = 1e-14;

/// Makes X and X K of a view in the scratch: `gram` there is the Gram matrix of [L r] (width + 1
/// squared, both triangles), `m` has the first `depth` rows of K.
inline void make_products(int width, int depth, int kin, ExpandScratch& s) {
  const int ld = static_cast<int>(s.gram.outerStride());
  const double* g = s.gram.data();
  kernels().expand(g, ld, width + 1, s.m.data(), s.stride, depth, kin, s.product.data(),
                   s.product_stride, s.block.data(), s.stride);
  double* parts = s.parts.data();
  std::fill_n(parts, kin, 0.0);
  for (int r = 0; r < depth; ++r) {
    const double norm = g[r + static_cast<size_t>(r) * ld];
    const double* m = s.m.data() + static_cast<size_t>(r) * s.stride;
    for (int j = 0; j < kin; ++j) parts[j] += norm * m[j] * m[j];
  }
  for (int j = 0; j < kin; ++j) {
    double* row = s.block.data() + static_cast<size_t>(j) * s.stride;
    if (row[j] > kCancelled * parts[j]) continue;
    for (int i = 0; i < j; ++i) s.block[static_cast<size_t>(i) * s.stride + j] = 0;
    std::fill(row + j, row + kin, 0.0);
    std::fill_n(s.product.begin() + static_cast<std::ptrdiff_t>(j) * s.product_stride, width + 1,
                0.0);
  }
}

/// Adds sums of shared columns to C and b; places in `columns` are those of `to`.
inline void add_shared(const SharedColumns& columns, const SharedSums& sums,
                       const GroupEquations& to) {
  const auto add = [&](int a, int b, double value) {
    to.shared[to.origin[std::min(a, b)] + std::max(a, b)] += value;
  };
  const int kin = columns.kinematic_size();
  for (int j = 0; j < kin; ++j) {
    const int a = to.row[columns.kinematic[j]];
    const double* block = sums.block + static_cast<size_t>(j) * sums.block_stride;
    const double* product = sums.product + static_cast<size_t>(j) * sums.product_stride;
    for (int i = j; i < kin;) {
      const int b = to.row[columns.kinematic[i]], run = columns.runs.empty() ? 1 : columns.runs[i];
      if (b < a || to.row[columns.kinematic[i + run - 1]] != b + run - 1) {
        add(a, b, block[i++]);
        continue;
      }
      double* row = to.shared + to.origin[a] + b;
      for (int k = 0; k < run; ++k) row[k] += block[i + k];
      i += run;
    }
    for (const OwnColumn& own : columns.own)
      add(a, to.row[own.place], own.sign * product[own.column]);
    to.gradient[a] += product[columns.width];
  }
  for (size_t j = 0; j < columns.own.size(); ++j) {
    const OwnColumn& own = columns.own[j];
    const int a = to.row[own.place];
    const double* gram = sums.gram + static_cast<size_t>(own.column) * sums.gram_stride;
    for (size_t i = j; i < columns.own.size(); ++i)
      add(a, to.row[columns.own[i].place],
          own.sign * columns.own[i].sign * gram[columns.own[i].column]);
    to.gradient[a] += own.sign * gram[columns.width];
  }
}

/// Adds M' G M to the equations of a group; `gram` and `m` in the scratch are as make_products()
/// wants them. Terms of shared unknowns are added to `sums`, if given. Does not allocate.
inline void expand(int depth, const ViewColumns& columns, const GroupShape& group, ExpandScratch& s,
                   const GroupEquations& to, const SharedSums* sums) {
  const int k = group.private_size, size = group.size(), width = columns.width;
  const int kin = static_cast<int>(columns.kinematic.size());
  const int* place = columns.kinematic.data();
  make_products(width, depth, kin, s);
  int own_rows = 0;  // columns of K that are private
  while (own_rows < kin && place[own_rows] < k) ++own_rows;
  for (int j = 0; j < own_rows; ++j) {
    double* row = to.rows + static_cast<std::ptrdiff_t>(place[j]) * to.stride;
    const double* block = s.block.data() + static_cast<size_t>(j) * s.stride;
    const double* product = s.product.data() + static_cast<size_t>(j) * s.product_stride;
#pragma GCC unroll 8
    for (int i = j; i < kin; ++i) row[place[i]] += block[i];
#pragma GCC unroll 4
    for (const OwnColumn& own : columns.own) row[own.place] += own.sign * product[own.column];
    row[size] += product[width];
  }
  const SharedSums view(s.gram.data(),
                        s.product.data() + static_cast<size_t>(own_rows) * s.product_stride,
                        s.block.data() + static_cast<size_t>(own_rows) * (s.stride + 1),
                        static_cast<int>(s.gram.outerStride()), s.product_stride, s.stride);
  const int shared = kin - own_rows;
  if (sums) {
    kernels().add_rows(sums->gram, sums->gram_stride, view.gram, view.gram_stride, width + 1,
                       width + 1, false);
    kernels().add_rows(sums->product, sums->product_stride, view.product, view.product_stride,
                       shared, width + 1, false);
    kernels().add_rows(sums->block, sums->block_stride, view.block, view.block_stride, shared,
                       shared, true);
    return;
  }
  s.columns.width = width;
  s.columns.kinematic.clear();
  s.columns.own.clear();
  for (int j = own_rows; j < kin; ++j) s.columns.kinematic.push_back(place[j] - k);
  for (const OwnColumn& own : columns.own)
    s.columns.own.push_back({own.column, own.place - k, own.sign});
  add_shared(s.columns, view, to);
}

}  // namespace kincal
