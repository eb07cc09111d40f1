// From the Gram matrix of one view to the normal equations of its group.
//
// Within one view J = L M (models/sensors/sensor.h): the small Gram matrix G of [L r] is
// accumulated first, then expanded to M' G M.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "../../solver/problem.h"
#include "../sensors/sensor.h"

namespace kincal {

/// ViewColumns describes one view's M: dense kinematic columns for the first rows of L, and single
/// columns of L that are unknowns themselves. Both stand in the order of their places in the group
/// (private unknowns first, then touched columns); own ones are shared.
struct ViewColumns {
  std::vector<int> kinematic;            // place of each column of M
  std::vector<std::pair<int, int>> own;  // (column of L, place)
};

/// ExpandScratch is the scratch of expand(): it is sized once for the largest view, so that nothing
/// is allocated later.
struct ExpandScratch {
  MatrixXd gram;                       // of [L r]
  RowMatrix m;                         // in its top left corner: M
  std::vector<double> product, block;  // row-major, `stride` apart: G M and M' G M
  std::vector<int> column;             // shared column of each column of M
  std::vector<double> parts;           // squared norms of what each column of L M is a sum of
  int stride = 0;

  /// Makes room for `width` columns of L, `depth` rows of M and `columns` columns of M.
  void reserve(int width, int depth, int columns) {
    gram.resize(width + 1, width + 1);
    stride = padded(columns) + kSlack;
    m.setZero(depth, stride);
    product.assign(static_cast<size_t>(width + 1) * stride, 0.0);
    block.assign(static_cast<size_t>(columns) * stride, 0.0);
    column.resize(columns);
    parts.resize(columns);
  }
};

/// Where L M is a sum of parts that cancel (a rotation about a point of the target itself),
/// rounding leaves 1e-16 of the parts, not 0: a column of at most this share of the parts' squared
/// norms is nothing.
constexpr double kCancelled = 1e-14;

/// Adds M' G M to the equations of a group: `gram` in the scratch is the Gram matrix of [L r]
/// (width + 1 squared, both triangles), `m` the kinematic part of M (its first `depth` rows). Does
/// not allocate.
inline void expand(int width, int depth, const ViewColumns& columns, const GroupShape& group,
                   ExpandScratch& s, const GroupEquations& to) {
  const int k = group.private_size, size = group.size();
  const int kin = static_cast<int>(columns.kinematic.size()),
            ld = static_cast<int>(s.gram.outerStride()), stride = s.stride;
  const double* g = s.gram.data();
  const int* place = columns.kinematic.data();
  kernels().expand(g, ld, width + 1, s.m.data(), stride, depth, kin, s.product.data(),
                   s.block.data(), stride);
  int own_rows = 0;  // columns of M that are private
  while (own_rows < kin && place[own_rows] < k) ++own_rows;
  double* parts = s.parts.data();
  std::fill_n(parts, kin, 0.0);
  for (int r = 0; r < depth; ++r) {
    const double norm = g[r + static_cast<size_t>(r) * ld];
    const double* m = s.m.data() + static_cast<size_t>(r) * stride;
    for (int j = 0; j < kin; ++j) parts[j] += norm * m[j] * m[j];
  }
  for (int j = 0; j < kin; ++j) {
    double* row = s.block.data() + static_cast<size_t>(j) * stride;
    if (row[j] > kCancelled * parts[j]) continue;
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
  for (int j = 0; j < own_rows; ++j)
    to.rows[static_cast<std::ptrdiff_t>(place[j]) * to.stride + size] += last[j];
  for (int j = own_rows; j < kin; ++j) to.gradient[s.column[j]] += last[j];
  for (const auto& own : columns.own) {
    const double* from = s.product.data() + static_cast<size_t>(own.first) * stride;
    const int column = to.row[own.second - k];
    int j = 0;
#pragma GCC unroll 4
    for (; j < own_rows; ++j)
      to.rows[static_cast<std::ptrdiff_t>(place[j]) * to.stride + own.second] += from[j];
    for (; j < kin && place[j] < own.second; ++j)
      to.shared[to.origin[s.column[j]] + column] += from[j];
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
