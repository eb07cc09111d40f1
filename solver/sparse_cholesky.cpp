#include "sparse_cholesky.h"

#include <algorithm>
#include <numeric>

#include "kernels.h"

namespace kincal {
namespace {

/// Whether runs of `columns` columns may be one front of which `zeros` (0 to 1) of the entries are
/// zeros: few columns are slow by themselves, many cost what their zeros cost.
bool worth(int columns, double zeros) {
  return zeros <= (columns <= 16 ? 0.8 : columns <= 48 ? 0.3 : 0.05);
}

/// Entries of the columns of a front.
double entries(double columns, double rows) { return columns * rows - columns * (columns - 1) / 2; }

}  // namespace

/// The elimination tree in a postorder, cut into fronts.
struct SparseCholesky::Tree {
  std::vector<int> run;                 // by place in the postorder
  std::vector<int> place;               // by run
  std::vector<std::vector<int>> below;  // by place: the later places that it couples, ascending
  std::vector<int> front_first;         // by front: its first place; and the number of places

  Tree(const std::vector<int>& first, const std::vector<SparseBlock>& blocks,
       const std::vector<int>& order) {
    const int runs = static_cast<int>(order.size());
    // By place in `order`: what each run couples, and its parent.
    std::vector<int> at(runs), parent(runs, -1);
    for (int k = 0; k < runs; ++k) at[order[k]] = k;
    std::vector<std::vector<int>> coupled(runs), children(runs);
    for (const SparseBlock& b : blocks)
      if (b.row != b.column)
        coupled[std::min(at[b.row], at[b.column])].push_back(std::max(at[b.row], at[b.column]));
    for (int k = 0; k < runs; ++k) {
      std::vector<int>& c = coupled[k];
      std::sort(c.begin(), c.end());
      c.erase(std::unique(c.begin(), c.end()), c.end());
      if (c.empty()) continue;
      parent[k] = c.front();
      children[c.front()].push_back(k);
      coupled[c.front()].insert(coupled[c.front()].end(), c.begin() + 1, c.end());
    }
    // Postorder; the child that couples most comes last, so that it can join its parent's front.
    std::vector<int> done, waiting;
    for (int k = runs; k-- > 0;)
      if (parent[k] < 0) waiting.push_back(k);
    while (!waiting.empty()) {  // parents before children, and all of it backwards
      const int k = waiting.back();
      waiting.pop_back();
      done.push_back(k);
      std::vector<int>& c = children[k];
      std::stable_sort(c.begin(), c.end(),
                       [&](int a, int b) { return coupled[a].size() < coupled[b].size(); });
      waiting.insert(waiting.end(), c.begin(), c.end());
    }
    std::reverse(done.begin(), done.end());
    std::vector<int> new_place(runs);
    place.resize(runs);
    for (int k = 0; k < runs; ++k) {
      new_place[done[k]] = k;
      run.push_back(order[done[k]]);
      place[run.back()] = k;
    }
    for (int k = 0; k < runs; ++k) {
      below.push_back(std::move(coupled[done[k]]));
      for (int& b : below.back()) b = new_place[b];
      std::sort(below.back().begin(), below.back().end());
    }
    cut(first);
  }

  /// A run joins the front before it where that is its child and few zeros come in.
  void cut(const std::vector<int>& first) {
    const auto size = [&](int k) { return first[run[k] + 1] - first[run[k]]; };
    int columns = 0;
    double exact = 0;
    for (size_t k = 0; k < run.size(); ++k) {
      int rows = size(static_cast<int>(k));
      for (const int b : below[k]) rows += size(b);
      const int own = size(static_cast<int>(k));
      const bool child =
          k > 0 && !below[k - 1].empty() && below[k - 1].front() == static_cast<int>(k);
      const double together = entries(columns + own, columns + rows);
      if (child && worth(columns + own, 1 - (exact + entries(own, rows)) / together)) {
        columns += own;
        exact += entries(own, rows);
        continue;
      }
      front_first.push_back(static_cast<int>(k));
      columns = own;
      exact = entries(own, rows);
    }
    front_first.push_back(static_cast<int>(run.size()));
  }
};

SparseCholesky::SparseCholesky(const std::vector<int>& first,
                               const std::vector<SparseBlock>& blocks,
                               const std::vector<std::ptrdiff_t>& start,
                               const std::vector<int>& order)
    : start_(start) {
  const Tree tree(first, blocks, order);
  place_fronts(tree, first);
  place_blocks(tree, first, blocks);
}

void SparseCholesky::place_fronts(const Tree& tree, const std::vector<int>& first) {
  const size_t fronts = tree.front_first.size() - 1;
  std::vector<int> front_of(tree.run.size());
  for (size_t f = 0; f < fronts; ++f)
    std::fill(front_of.begin() + tree.front_first[f], front_of.begin() + tree.front_first[f + 1],
              static_cast<int>(f));
  std::vector<std::vector<int>> children(fronts);
  std::vector<int> row_of(first.back());  // in the front at hand, of columns of the matrix
  size_t factor = 0, stack = 0, deepest = 0, widest = 0;
  for (size_t f = 0; f < fronts; ++f) {
    Front front;
    front.factor = factor;
    front.row = row_.size();
    front.child = children_.size();
    const auto add = [&](int k) {
      for (int c = first[tree.run[k]]; c < first[tree.run[k] + 1]; ++c) {
        row_of[c] = static_cast<int>(row_.size() - front.row);
        row_.push_back(c);
      }
    };
    const int last = tree.front_first[f + 1] - 1;
    for (int k = tree.front_first[f]; k <= last; ++k) add(k);
    front.columns = static_cast<int>(row_.size() - front.row);
    for (const int k : tree.below[last]) add(k);  // it couples all that those before it do
    front.rows = static_cast<int>(row_.size() - front.row);
    for (const int c : children[f]) {
      const Front& child = fronts_[c];
      children_.push_back({c, to_.size()});
      for (int i = child.columns; i < child.rows; ++i) to_.push_back(row_of[row_[child.row + i]]);
      stack = std::min(stack, child.left);
    }
    front.left = stack;
    const size_t left = static_cast<size_t>(front.rows - front.columns);
    stack += left * left;
    deepest = std::max(deepest, stack);
    factor += static_cast<size_t>(front.columns) * front.rows;
    widest = std::max(widest, static_cast<size_t>(front.rows));
    if (!tree.below[last].empty())
      children[front_of[tree.below[last].front()]].push_back(static_cast<int>(f));
    fronts_.push_back(front);
  }
  fronts_.emplace_back();
  fronts_.back().child = children_.size();
  factor_.resize(factor);
  stack_.resize(deepest);
  right_.resize(widest);
  front_.assign((padded(static_cast<int>(widest)) + kSlack) * widest + kSlack, 0.0);
}

void SparseCholesky::place_blocks(const Tree& tree, const std::vector<int>& first,
                                  const std::vector<SparseBlock>& blocks) {
  const size_t fronts = fronts_.size() - 1;
  std::vector<int> front_of(tree.run.size());
  for (size_t f = 0; f < fronts; ++f)
    std::fill(front_of.begin() + tree.front_first[f], front_of.begin() + tree.front_first[f + 1],
              static_cast<int>(f));
  std::vector<std::vector<const SparseBlock*>> of_front(fronts);
  for (const SparseBlock& b : blocks)
    of_front[front_of[std::min(tree.place[b.row], tree.place[b.column])]].push_back(&b);
  std::vector<int> row_of(first.back());
  for (size_t f = 0; f < fronts; ++f) {
    fronts_[f].block = blocks_.size();
    for (int i = 0; i < fronts_[f].rows; ++i) row_of[row_[fronts_[f].row + i]] = i;
    for (const SparseBlock* b : of_front[f]) {
      Placed p;
      p.column = first[b->column];
      p.columns = first[b->column + 1] - p.column;
      p.rows = first[b->row + 1] - first[b->row];
      p.place = b->place;
      p.transposed = tree.place[b->row] < tree.place[b->column];
      p.to_row = row_of[p.transposed ? p.column : first[b->row]];
      p.to_column = row_of[p.transposed ? first[b->row] : p.column];
      blocks_.push_back(p);
    }
  }
  fronts_.back().block = blocks_.size();
}

/// F = the front's columns of A + what its children left.
void SparseCholesky::assemble(size_t f, const double* values, int ld) {
  const Front &front = fronts_[f], &next = fronts_[f + 1];
  double* const to = front_.data();
  for (int j = 0; j < front.rows; ++j)
    std::fill_n(to + j + static_cast<std::ptrdiff_t>(j) * ld, front.rows - j, 0.0);
  for (size_t k = front.block; k < next.block; ++k) {
    const Placed& b = blocks_[k];
    const bool diagonal = b.to_row == b.to_column;
    double* corner = to + b.to_row + static_cast<std::ptrdiff_t>(b.to_column) * ld;
    for (int q = 0; q < b.columns; ++q) {
      const double* column = values + start_[b.column + q] + b.place;
      for (int i = diagonal ? q : 0; i < b.rows; ++i)
        corner[b.transposed ? q + static_cast<std::ptrdiff_t>(i) * ld
                            : i + static_cast<std::ptrdiff_t>(q) * ld] = column[i];
    }
  }
  for (size_t k = front.child; k < next.child; ++k) {
    const Front& child = fronts_[children_[k].front];
    const int* row = to_.data() + children_[k].to;
    const int n = child.rows - child.columns;
    for (int j = 0; j < n; ++j) {
      const double* left = stack_.data() + child.left + static_cast<size_t>(j) * n;
      double* column = to + static_cast<std::ptrdiff_t>(row[j]) * ld;
      for (int i = j; i < n; ++i) column[row[i]] += left[i];
    }
  }
}

bool SparseCholesky::factor(const double* values) {
  for (size_t f = 0; f + 1 < fronts_.size(); ++f) {
    const Front& front = fronts_[f];
    const int ld = padded(front.rows) + kSlack;
    assemble(f, values, ld);
    if (!kernels().partial_cholesky(front_.data(), front.rows, front.columns, ld)) return false;
    const int n = front.rows - front.columns;
    for (int j = 0; j < front.columns; ++j)
      std::copy_n(front_.data() + j + static_cast<std::ptrdiff_t>(j) * ld, front.rows - j,
                  factor_.data() + front.factor + j + static_cast<size_t>(j) * front.rows);
    const double* rest = front_.data() + front.columns * (static_cast<std::ptrdiff_t>(ld) + 1);
    for (int j = 0; j < n; ++j)
      std::copy_n(rest + j + static_cast<std::ptrdiff_t>(j) * ld, n - j,
                  stack_.data() + front.left + j + static_cast<size_t>(j) * n);
  }
  return true;
}

void SparseCholesky::solve(double* b) {
  double* x = right_.data();
  for (size_t f = 0; f + 1 < fronts_.size(); ++f) {
    const Front& front = fronts_[f];
    const int* row = row_.data() + front.row;
    for (int i = 0; i < front.rows; ++i) x[i] = b[row[i]];
    for (int j = 0; j < front.columns; ++j) {
      const double* column = factor_.data() + front.factor + static_cast<size_t>(j) * front.rows;
      const double solved = x[j] *= column[j];
      for (int i = j + 1; i < front.rows; ++i) x[i] -= column[i] * solved;
    }
    for (int i = 0; i < front.rows; ++i) b[row[i]] = x[i];
  }
  for (size_t f = fronts_.size() - 1; f-- > 0;) {
    const Front& front = fronts_[f];
    const int* row = row_.data() + front.row;
    for (int i = 0; i < front.rows; ++i) x[i] = b[row[i]];
    for (int j = front.columns; j-- > 0;) {
      const double* column = factor_.data() + front.factor + static_cast<size_t>(j) * front.rows;
      double sum = x[j];
      for (int i = j + 1; i < front.rows; ++i) sum -= column[i] * x[i];
      x[j] = sum * column[j];
    }
    for (int i = 0; i < front.columns; ++i) b[row[i]] = x[i];
  }
}

}  // namespace kincal
