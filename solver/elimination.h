// The elimination of all groups' private unknowns into the reduced system, and the way back: the
// arrowhead of problem.h at one state and one damping. The formulas stand in levenberg_marquardt.h.
// This header is for the sources of this folder only.
#pragma once

#include <atomic>
#include <functional>
#include <memory>
#include <vector>

#include "aligned.h"
#include "problem.h"
#include "reduced_system.h"
#include "threads.h"

namespace kincal {

/// A GroupStore says where one group keeps its numbers between linearisation and substitution: its
/// rows [P Q a], in whose lower triangle of P the factor of the damped P is kept, as an offset into
/// an arena. The groups of a RangeProblem keep nothing; their offsets are into the worker's
/// scratch.
struct GroupStore {
  size_t rows = 0;
  int private_start = 0;
};

/// A Piece is a range of groups of the partition, with its sums, on cache lines of its own: two
/// threads write to the sums of two pieces at the same time.
struct alignas(kCacheLine) Piece {
  int first = 0, last = 0;
  Cost cost;
  bool defined = true, definite = true;
  double slope = 0, damping = 0;
};

/// Sums are what groups add to the reduced system.
struct Sums {
  AlignedNumbers shared;      // C
  AlignedNumbers eliminated;  // minus the sum of B_Q' B_Q, in blocks if the system has them
  VectorXd gradient, eliminated_gradient;
};

/// A Share is some neighbouring pieces, whose sums are added here in the pieces' order; the totals
/// are the sums of the shares in theirs. Threads begin with different shares (ThreadPool::run), so
/// that these matrices seldom go from one core to another, which is what slows two threads down
/// whose cores share no cache.
struct alignas(kCacheLine) Share {
  int first = 0;             // piece
  std::atomic<int> turn{0};  // piece whose sums are added next
  Sums sums;
};

/// A Worker is the scratch of one thread.
struct alignas(kCacheLine) Worker {
  Sums sums;                           // of the current piece
  std::vector<double> rows;            // of a RangeProblem: of kRange groups
  AlignedNumbers factor;               // of the damped P of one group
  AlignedNumbers right;                // B of one group
  AlignedNumbers stacked, stack_sums;  // rows of all stacks; minus the sums of their products
  std::vector<int> height;             // of each stack: how many rows there are
  AlignedNumbers block;                // sparse: C of one group
  AlignedNumbers solution;             // private step of one group
  AlignedNumbers touched;              // shared steps of one group's columns
};

/// A Stack collects eliminated rows [B_Q | B_a] of groups, over some shared columns and b, to be
/// multiplied at once: of all groups that touch the same columns, if they are many, else of all
/// others over all columns. The products of a piece are summed over the stack's columns and go to
/// their places at its end; over all columns they are summed there.
struct Stack {
  std::vector<int> columns;             // shared columns, then their number for b
  size_t first_row = 0, first_sum = 0;  // in a worker's arrays
  int ld = 0;                           // of both
  bool whole = false;                   // over all columns
  int width() const { return static_cast<int>(columns.size()); }
};

/// An Arrowhead holds what is kept of the groups between linearisation and substitution, and all
/// matrices. They are allocated once.
class Arrowhead {
 public:
  Arrowhead(Problem& p, LinearSolver linear_solver, int threads);

  /// Sums the cost of all groups; false where a residual is undefined.
  bool evaluate(const VectorXd& state, Cost& cost);
  enum class Assembly { fine, undefined, indefinite };
  /// Assembles the damped reduced system at `state`. With `linearise` the normal equations are new;
  /// without, only the damping is.
  Assembly assemble(const VectorXd& state, double lambda, bool linearise, bool first_scales,
                    Cost& cost);
  /// Makes the normal equations at `state` and sums the cost; false where a residual is undefined.
  /// What was linearised before is gone. assemble() without `linearise` goes on from there.
  bool linearise(const VectorXd& state, Cost& cost);
  /// Finds what the Gram matrix lacks of the second derivatives at `state` (levenberg_marquardt.h),
  /// which assemble() adds to what it linearises from then on, until forget_curvature(). It takes
  /// as many linearisations as the widest group has private unknowns and the problem shared ones;
  /// the first time it allocates. Returns false, and there is none, for range problems and sparse
  /// systems, and where a residual is undefined close by. `before_each` linearisation is called and
  /// may throw: then there is none, too.
  bool find_curvature(const VectorXd& state, const std::function<void()>& before_each);
  /// Allocates what it needs, for states of this size.
  void reserve_curvature(Eigen::Index state_size);
  /// Returns whether second derivatives can be looked for.
  bool bends() const { return !ranges && system.dense(); }
  void forget_curvature() { curved = false; }
  bool has_curvature() const { return curved; }
  /// Return what assemble() has made.
  AlignedNumbers& damped_matrix() {
    return system.in_blocks() ? whole_matrix : totals().eliminated;
  }
  const VectorXd& reduced_gradient() const { return shares.front().sums.eliminated_gradient; }
  /// Solves for the step of the assembled system at damping lambda, and gives its promised decrease
  /// of twice the cost and its length in standard deviations.
  bool step(const VectorXd& state, double lambda, double& promised, double& length);

  Problem& problem;
  const RangeProblem* const ranges;  // the same problem if it is one, else null
  int n, private_size = 0;
  int widest = 0, deepest = 0;  // most shared columns and most private unknowns of a group
  double rows = 0;
  const std::vector<GroupShape>& groups;
  ReducedSystem system;
  VectorXd shared_step, private_step;
  VectorXd shared_scale, private_scale;

 private:
  /// A Pass over all groups: what it does.
  struct Pass {
    bool linearise, eliminate, first_scales;
    double lambda;
  };
  struct Linearisation {
    std::vector<double> rows;  // as group_rows
    AlignedNumbers shared;     // as Sums
    VectorXd gradient;         // shared
  };
  struct Column {
    const double* first;
    int stride;  // from one number to the next
  };
  void place_pieces();
  void place_stacks();
  template <class Work>
  std::vector<Piece> partition(int most, const Work& work) const;
  /// Returns the distance between the rows of a group.
  int stride(size_t g) const {
    return groups[g].private_size + static_cast<int>(groups[g].columns.size()) + 1;
  }
  template <class Work>
  void over(std::vector<Piece>& partition, const Work& work);
  bool evaluate_each(Piece& p, const VectorXd& state, int worker) const;
  double* rows_of(size_t g, int first, int worker);
  bool linearise_beside(const VectorXd& state);
  void bend_private(size_t g, int k);
  void bend_shared(int k);
  void pass_over(Piece& p, const VectorXd& state, const Pass& pass, int worker);
  Sums& totals() { return shares.front().sums; }
  void add_sums(Sums& to, const Sums& from, const Pass& pass) const;
  void add_shares(const Pass& pass);
  Assembly run(const VectorXd& state, const Pass& pass, Cost& cost);
  bool linearise_range(Piece& p, int first, int last, const VectorXd& state, int worker);
  bool factor_private(size_t g, const double* rows, int width, double lambda, int worker);
  void keep_factor(size_t g, double* rows, int worker);
  void fetch_factor(size_t g, const double* rows, int worker);
  bool eliminate_group(size_t g, double* rows, double lambda, int worker);
  void eliminate_onto(const Stack& stack, size_t g, const double* rows, int worker);
  void clear_eliminated(int worker);
  void multiply(int stack, int worker);
  void add_stacks(int worker);
  void substitute(Piece& p, size_t g, const double* rows, double lambda, int worker);
  void substitute_range(Piece& p, int first, int last, const VectorXd& state, double lambda,
                        int worker);
  void private_steps(Piece& p, size_t g, const Column& a, double lambda, int worker);

  ThreadPool pool;
  std::vector<Piece> pieces, fine_pieces;
  std::vector<Share> shares;  // of `pieces`; the sums of the first one become the totals
  std::vector<GroupStore> stores;
  std::vector<Stack> stacks;
  std::vector<int> stack_of;  // by group
  std::unique_ptr<double[]> group_rows;
  bool curved = false;
  std::vector<double> rows_curvature, shared_curvature;  // in places of group_rows, Sums
  Linearisation here;                                    // of find_curvature()
  VectorXd shared_move, private_move, beside;
  std::vector<Worker> workers;
  std::vector<int> identity;
  std::vector<std::ptrdiff_t> block_origin;
  AlignedNumbers whole_matrix;  // of a system in blocks
  std::vector<double> right_side;
  VectorXd first_shared_scale, first_private_scale;
  VectorXd factor_diagonal;  // of the factors of all P, inverse
};

}  // namespace kincal
