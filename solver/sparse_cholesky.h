// Cholesky factorisation of a sparse matrix whose columns come in runs, by fronts: the multifrontal
// method (Duff and Reid, The multifrontal solution of indefinite sparse symmetric linear equations,
// 1983) with relaxed supernodes (Ashcraft and Grimes, 1989).
//
// Runs are eliminated in a given order. Eliminating run k couples all later runs that it touches
// itself or that earlier ones left to it; the first of them is its parent in the elimination tree.
// In a postorder of that tree, runs of a chain that couple (nearly) the same are one front. Its
// columns are eliminated together, in a dense array of
//     F = [F11 .; F21 F22] = its columns of A + what its children left,
//     F11 = L11 L11',  L21 = F21 L11^-T,  left to its parent: F22 - L21 L21'.
// So all arithmetic is that of the dense kernels. A factorisation column by column does the same
// with numbers one by one, scattered.
#pragma once

#include <cstddef>
#include <vector>

namespace kincal {

/// A SparseBlock is a part of the lower triangle: the rows of run `row` in the columns of run
/// `column`. Row i of the columns' q-th begins at values[start[q] + place + i], `start` of that
/// column of the matrix; of a diagonal block only i >= q counts.
struct SparseBlock {
  int row, column, place;
};

class SparseCholesky {
 public:
  /// `first`: first column of each run, and the number of all columns behind them. `blocks`: those
  /// of the diagonal and whatever else there is. `order`: of the runs' elimination. Allocates all
  /// that factor() and solve() need. `start` must outlive this, the rest is copied.
  SparseCholesky(const std::vector<int>& first, const std::vector<SparseBlock>& blocks,
                 const std::vector<std::ptrdiff_t>& start, const std::vector<int>& order);

  /// Factors the matrix with these values; false if it is not positive definite to rounding.
  bool factor(const double* values);
  /// Solves A x = b in place, after factor(), in the matrix's own order of columns.
  void solve(double* b);

 private:
  /// A Front eliminates `columns` of its `rows`, which are columns of the matrix: those that are
  /// eliminated first.
  struct Front {
    int columns = 0, rows = 0;
    size_t factor = 0;            // L11 over L21, `rows` apart
    size_t row = 0;               // its rows in row_
    size_t left = 0;              // F22 on the stack, order rows - columns
    size_t block = 0, child = 0;  // the first of its own in blocks_ and children_
  };
  /// A Placed block of the matrix, in its front.
  struct Placed {
    int column, columns, rows, place;  // in the matrix: first column, size, place
    int to_row, to_column;             // in the front
    bool transposed;
  };
  /// A Child is what another front left, with the row of its own that each row of it is.
  struct Child {
    int front;
    size_t to;  // in to_
  };
  struct Tree;
  void place_fronts(const Tree& tree, const std::vector<int>& first);
  void place_blocks(const Tree& tree, const std::vector<int>& first,
                    const std::vector<SparseBlock>& blocks);
  void assemble(size_t front, const double* values, int ld);

  const std::vector<std::ptrdiff_t>& start_;
  std::vector<Front> fronts_;  // children before parents; one more behind the last
  std::vector<Placed> blocks_;
  std::vector<Child> children_;
  std::vector<int> row_, to_;
  std::vector<double> factor_, front_, stack_, right_;
};

}  // namespace kincal
