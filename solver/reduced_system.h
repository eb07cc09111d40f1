// The reduced system S dx = -b of the shared unknowns: where its numbers are, how groups are
// eliminated into it, its factorisation.
//
// Dense: a square array with leading dimension ld() (lower triangle; row n holds the vector that
// the elimination subtracts from b), own Cholesky kernel. Sparse: the lower triangle in compressed
// columns over the union of the groups' column sets, analysed once, ordered by CHOLMOD's AMD over
// runs (it is loaded with the first sparse system). A run is a range of columns that the same
// groups touch (a camera's numbers): all its columns have the same pattern, so that the place of a
// whole block is one number. Factored by fronts (sparse_cholesky.h), or by CHOLMOD's simplicial
// Cholesky (LGPL; the supernodal module is GPL: KINCAL_SUPERNODAL), which is there to compare with.
#pragma once

#include <Eigen/Core>
#include <memory>
#include <vector>

#include "kernels.h"
#include "problem.h"
#include "sparse_cholesky.h"

namespace kincal {

class ThreadPool;  // threads.h

/// GroupKinds says which groups couple less than all that they touch: all groups are those of a
/// RangeProblem, or `priors` is that of the priors (-1: none), which couple columns of one run
/// only.
struct GroupKinds {
  bool ranges = false;
  int priors = -1;
};

class ReducedSystem {
 public:
  /// Chooses a method and analyses the structure. `automatic` means dense up to 400 unknowns or
  /// when more than 30 % of the entries are there, else sparse.
  ReducedSystem(int n, const std::vector<GroupShape>& groups, LinearSolver choice,
                GroupKinds kinds = {});
  ~ReducedSystem();

  const char* name() const { return dense_ ? "dense" : fronts_ ? "sparse" : "cholmod"; }
  bool dense() const { return dense_; }
  /// Returns the numbers of one accumulator (so that several workers can have one each).
  size_t storage() const {
    return dense_ ? static_cast<size_t>(ld_) * (n_ + 1) : row_of_.size() + kSlack;
  }
  /// Entry (i, j), i >= j, of the same run, or any if dense, stands at origin()[j] + i.
  const std::ptrdiff_t* origin() const { return origin_.data(); }
  /// The same holds for an array of the runs' diagonal blocks only, which has diagonal_storage()
  /// numbers.
  const std::ptrdiff_t* diagonal_origin() const { return diagonal_origin_.data(); }
  size_t diagonal_storage() const { return diagonal_storage_; }

  /// True if the system is dense and most groups touch most columns: eliminated rows are then best
  /// stacked, n + 1 wide, and multiplied at once.
  bool stacks() const { return stacks_; }
  int ld() const { return ld_; }

  /// Adds a block of a sparse system to `values` (lower triangle over the group's touched columns,
  /// leading dimension ld).
  void add(int group, const double* block, int ld, double* values) const;
  /// Subtracts B_Q' B_Q from `values` and B_Q' B_a from `gradient`, with depth rows [B_Q | B_a]
  /// over the group's touched columns, `stride` apart.
  void subtract(int group, const double* b, int depth, std::ptrdiff_t stride, double* values,
                double* gradient) const;
  /// True for a RangeProblem whose runs have 9 columns and whose groups have 3 private unknowns
  /// (bundle adjustment). subtract_blocks() does the same there, faster, to an array of blocks
  /// (kernels.h) that lie together whatever the matrix looks like; put_blocks() writes the sums of
  /// `count` such arrays, added in this order, to their places: all that count, if it is called for
  /// all parts. There is no add() then.
  bool in_blocks() const { return in_blocks_; }
  size_t block_storage() const { return blocks_.size() * kBlockStorage9x9 + 2 * kSlack; }
  void subtract_blocks(int group, const double* b, std::ptrdiff_t stride, double* blocks,
                       double* gradient) const;
  struct Part {
    int index, of;  // of as many parts of all blocks
  };
  void put_blocks(double* values, const double* const* sums, int count, Part part) const;
  /// Sets to 0 the numbers of one accumulator that count.
  void clear(double* values) const;
  /// Adds the numbers of one accumulator that count to another.
  void accumulate(double* to, const double* from) const;
  /// Adds the runs' diagonal blocks to `values`.
  void add_diagonal_blocks(double* values, const double* blocks) const;
  void add_to_diagonal(double* values, int i, double v) const { values[origin_[i] + i] += v; }

  /// Returns the whole matrix, both triangles, for tests.
  MatrixXd full(const double* values) const;

  /// Factors the matrix; false if it is not positive definite to rounding. A dense system is
  /// factored in place, without allocation, by the whole pool if it is large: the same bits.
  bool factor(double* values, ThreadPool& pool);
  /// Solves S x = b in place, after factor(); b has kSlack numbers behind its n.
  void solve(const double* factored, double* b);

 private:
  struct Run {
    int first, size;
  };
  struct Cholmod;
  /// A RunGraph has the runs below each run that some group touches with it (itself first), run by
  /// run: compressed columns of the lower triangle.
  struct RunGraph {
    std::vector<int> start{0}, row;
  };
  /// Work is that of an elimination: of all columns by each group, and of those that it touches.
  struct Work {
    double full = 0, touched = 0;
  };
  void find_runs();
  Work place_runs();
  RunGraph graph_of_runs(size_t& entries) const;
  void place_dense(const Work& work);
  void place_sparse(RunGraph& graph, bool cholmod);
  template <class BlockOf>
  void place_blocks(const BlockOf& block_of);

  int n_, ld_ = 0;
  bool dense_, stacks_ = false;
  const std::vector<GroupShape>* groups_;
  GroupKinds kinds_;
  std::vector<Run> runs_;
  std::vector<int> group_runs_, group_runs_start_;  // runs of each group, ascending
  std::vector<int> group_firsts_;                   // their first columns
  struct Block {
    int row, column, place;  // runs; sparse: as in pair_places_
  };
  bool in_blocks_ = false;
  std::vector<Block> blocks_;
  std::vector<int> group_blocks_;  // for i, for j <= i: the block of the group's runs i and j
  std::vector<size_t> group_blocks_start_;
  std::vector<int>
      pair_places_;  // sparse: group after group, for b, for a > b: block (a, b) in b's columns
  std::vector<size_t> pair_start_;
  std::vector<std::ptrdiff_t> origin_, diagonal_origin_,
      step_;  // step_: start of each column as blocks below the diagonal see it
  size_t diagonal_storage_ = 0;
  std::vector<int> column_start_, row_of_;  // lower triangle, compressed columns, diagonal first
  std::unique_ptr<SparseCholesky> fronts_;  // or:
  std::unique_ptr<Cholmod> cholmod_;
};

}  // namespace kincal
