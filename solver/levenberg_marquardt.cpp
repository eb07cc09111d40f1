#include "levenberg_marquardt.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <thread>

#include "threads.h"

namespace kincal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kConvergedStep = 1e-7;      // standard deviations
constexpr double kSmallestDamping = 1e-10;   // keeps directions without information where they are, biases nothing else
constexpr double kUndamped = 1e-9;           // up to here a step's length means distance to the minimum
constexpr double kRoundingShare = 1e-12;     // of the cost: what is promised below it may be rounding
constexpr double kFaithful = 0.03;           // from 1: a gain that allows to give up damping fast
constexpr int kMemory = 3;                   // steps that the acceleration looks back
constexpr int kPieces = 16, kFewPieces = 4;  // of the partition, whatever the number of threads

constexpr int kStackedRows = 64;  // eliminated rows that are multiplied at once

/// What one group keeps between linearisation and substitution: its rows [P Q a] and the factor of the damped P. Offsets into arenas;
/// light problems (Problem::light) keep nothing, theirs are offsets into the worker's scratch.
struct GroupStore {
  size_t rows = 0, factor = 0;
  int private_start = 0;
};

/// One piece of the partition: its groups and its sums.
struct Piece {
  int first = 0, last = 0;
  Cost cost;
  bool defined = true, definite = true;
  double slope = 0, damping = 0;
};

/// Scratch of one worker: matrices and vectors of the piece at hand, added to the totals in the pieces' order.
struct Worker {
  std::vector<double> shared;      // C
  std::vector<double> eliminated;  // minus the sum of B_Q' B_Q, in blocks if the system has them
  VectorXd gradient, eliminated_gradient;
  std::vector<double> rows, factor;  // light problems: of kRange groups
  std::vector<double> right;         // B of one group
  std::vector<double> stack;         // eliminated rows over all columns
  std::vector<double> block;         // sparse: C of one group
  std::vector<double> solution;      // private step of one group
};

/// The first place in an array with slack where a cache line begins.
double* aligned(std::vector<double>& array) {
  const std::uintptr_t at = reinterpret_cast<std::uintptr_t>(array.data());
  return reinterpret_cast<double*>((at + 63) & ~std::uintptr_t(63));
}

/// Five steps in a row, none of them half of an earlier one; infinite: a step that still promised something.
bool settled(const std::vector<double>& sizes) {
  if (sizes.size() < 6) return false;
  double smallest_before = kInfinity, smallest = kInfinity, largest = 0;
  for (size_t i = 0; i + 5 < sizes.size(); ++i) smallest_before = std::min(smallest_before, sizes[i]);
  for (size_t i = sizes.size() - 6; i < sizes.size(); ++i) largest = std::max(largest, sizes[i]);
  for (size_t i = sizes.size() - 5; i < sizes.size(); ++i) smallest = std::min(smallest, sizes[i]);
  return largest < kInfinity && smallest > 0.5 * smallest_before;
}

}  // namespace

struct LevenbergMarquardt::Workspace {
  Workspace(Problem& p, SolverOptions o)
      : problem(p),
        options(std::move(o)),
        n(p.shared_size()),
        groups(p.groups()),
        light(p.light()),
        system(n, groups, options.linear_solver, light),
        crew(std::max(1, options.threads)) {
    problem.set_workers(crew.size());
    size_t rows_size = 0, factor_size = 0, largest_rows = 0, largest_factor = 0;
    int deepest = 0;
    stores.resize(groups.size());
    for (size_t g = 0; g < groups.size(); ++g) {
      const int k = groups[g].private_size;
      stores[g] = {rows_size, factor_size, private_size};
      const size_t r = static_cast<size_t>(k) * stride(g), f = static_cast<size_t>(k) * (k + kSlack);
      rows_size += r;
      factor_size += f;
      largest_rows = std::max(largest_rows, r);
      largest_factor = std::max(largest_factor, f);
      widest = std::max(widest, static_cast<int>(groups[g].columns.size()));
      deepest = std::max(deepest, k);
      private_size += k;
      rows += groups[g].rows;
    }
    if (!light) {
      // Not filled: who works on a group touches its memory first.
      group_rows.reset(new double[rows_size + kSlack]);
      group_factors.reset(new double[factor_size + kSlack]);
    }
    place_pieces();
    for (int i = 0; i < std::max(widest, n); ++i) {
      identity.push_back(i);
      block_origin.push_back(static_cast<std::ptrdiff_t>(i) * widest);
    }
    workers.resize(crew.size());
    for (Worker& w : workers) {
      w.shared.resize(light ? system.diagonal_storage() + kSlack : system.storage());
      w.eliminated.resize(system.in_blocks() ? system.block_storage() : system.storage());
      w.gradient.setZero(n);
      w.eliminated_gradient.setZero(n);
      if (light) {
        w.rows.resize(largest_rows * Problem::kRange + kSlack);
        w.factor.resize(largest_factor * Problem::kRange + kSlack);
      }
      w.right.resize(static_cast<size_t>(std::max(deepest, 1)) * padded(widest + 1) + kSlack);
      if (system.stacks()) w.stack.resize(static_cast<size_t>(kStackedRows + deepest) * system.ld() + kSlack);
      if (!system.dense() && !light) w.block.resize(static_cast<size_t>(widest) * widest);
      w.solution.resize(deepest + kSlack);
    }
    // Dense arrays may be read up to their slack: zero once.
    shared_matrix.assign(light ? system.diagonal_storage() : system.storage(), 0.0);
    damped_matrix.assign(system.storage(), 0.0);
    if (system.in_blocks()) eliminated_blocks.assign(system.block_storage(), 0.0);
    for (VectorXd* v : {&shared_gradient, &reduced_gradient, &shared_step, &shared_scale, &first_shared_scale}) v->setZero(n);
    for (VectorXd* v : {&private_step, &private_scale, &first_private_scale}) v->setZero(private_size);
    right_side.assign(n + kSlack, 0.0);
    if (light) return;
    for (std::vector<VectorXd>* vectors : {&found, &taken}) vectors->assign(kMemory + 1, VectorXd::Zero(n + private_size));
    plain.setZero(n + private_size);
    change.setZero(n + private_size, kMemory);
    weighted.setZero(n + private_size, kMemory);
  }

  /// Contiguous pieces of about equal work (rows and columns), the same for any number of threads.
  void place_pieces() {
    const auto eliminating = [](const GroupShape& g) {
      const double m = static_cast<double>(g.columns.size());
      return 20.0 * g.rows + 0.012 * g.private_size * m * m;
    };
    double total = 0;
    for (const GroupShape& g : groups) total += eliminating(g);
    // Each has matrices to be added up: as many as keep that small beside the rest.
    const double storage = static_cast<double>(system.in_blocks() ? system.block_storage() : system.storage());
    int most = kPieces;
    while (most > kFewPieces && total < 8 * most * storage) most /= 2;
    pieces = partition(most, eliminating);
    fine_pieces = partition(kPieces, [](const GroupShape& g) { return g.rows + 5.0; });
  }
  template <class Work>
  std::vector<Piece> partition(int most, const Work& work) const {
    double total = 0, sum = 0;
    for (const GroupShape& g : groups) total += work(g);
    std::vector<Piece> out(1);
    for (size_t g = 0; g < groups.size(); ++g) {
      sum += work(groups[g]);
      out.back().last = static_cast<int>(g) + 1;
      if (sum * most < total * out.size() || out.size() == static_cast<size_t>(most) || g + 1 == groups.size()) continue;
      out.emplace_back();
      out.back().first = static_cast<int>(g) + 1;
    }
    return out;
  }

  /// Between the rows of a group.
  int stride(size_t g) const { return groups[g].private_size + padded(static_cast<int>(groups[g].columns.size()) + 1); }

  /// Runs work(piece, worker) over all pieces, of the partition for matrices or of the finer one for sums of numbers.
  template <class Work>
  void over(std::vector<Piece>& partition, const Work& work) {
    crew.run(static_cast<int>(partition.size()), [&](int piece, int worker) { work(partition[piece], worker); });
  }

  bool evaluate(const VectorXd& state, Cost& cost) {
    over(fine_pieces, [&](Piece& p, int worker) {
      p.cost = {};
      p.defined = problem.evaluate_range(p.first, p.last, state, worker, p.cost);
    });
    cost = {};
    bool defined = true;
    for (const Piece& p : fine_pieces) {
      cost.twice += p.cost.twice;
      cost.chi2 += p.cost.chi2;
      defined = defined && p.defined;
    }
    return defined && std::isfinite(cost.twice);
  }

  struct Room {
    double *rows, *factor;
  };
  Room room(size_t g, int first, int worker) {
    Worker& w = workers[worker];
    return light ? Room{w.rows.data() + (stores[g].rows - stores[first].rows), w.factor.data() + (stores[g].factor - stores[first].factor)}
                 : Room{group_rows.get() + stores[g].rows, group_factors.get() + stores[g].factor};
  }

  /// Equations of groups first .. last - 1 (of one range): rows to their room, C and b to the worker's.
  bool linearise_range(Piece& p, int first, int last, const VectorXd& state, int worker) {
    Worker& w = workers[worker];
    problem.approach(first, last, state, worker);
    for (int g = first; g < last; ++g) {
      const int k = groups[g].private_size;
      double* rows_of_group = room(g, first, worker).rows;
      std::fill_n(rows_of_group, static_cast<size_t>(k) * stride(g), 0.0);
      GroupEquations to{rows_of_group, stride(g), w.shared.data(), system.origin(), groups[g].columns.data(), w.gradient.data()};
      const bool local = !system.dense() && !light;
      const size_t m = groups[g].columns.size();
      if (light) to.origin = system.diagonal_origin();
      if (local) {
        std::fill(w.block.begin(), w.block.end(), 0.0);
        w.right.assign(w.right.size(), 0.0);
        to.shared = w.block.data();
        to.origin = block_origin.data();
        to.row = identity.data();
        to.gradient = w.right.data();
      }
      Cost c;
      if (!problem.linearise(g, state, worker, to, c)) return false;
      p.cost.twice += c.twice;
      p.cost.chi2 += c.chi2;
      if (!local) continue;
      system.add(g, w.block.data(), widest, w.shared.data());
      for (size_t i = 0; i < m; ++i) w.gradient(groups[g].columns[i]) += w.right[i];
    }
    return true;
  }

  /// Factor of the damped private block of a group, whose rows are `width` apart; false if it is not positive definite to rounding.
  bool factor_private(size_t g, const Room& at, int width, double lambda) {
    const int k = groups[g].private_size, ld = k + kSlack;
    for (int j = 0; j < k; ++j)
      for (int i = j; i < k; ++i) at.factor[i + static_cast<size_t>(j) * ld] = at.rows[static_cast<size_t>(j) * width + i];
    for (int i = 0; i < k; ++i) {
      const double scale = private_scale(stores[g].private_start + i);
      at.factor[i + static_cast<size_t>(i) * ld] += scale > 0 ? lambda * scale : 1.0;  // a column of zeros: its step is 0
    }
    return kernels().cholesky(at.factor, k, ld);
  }

  /// Eliminates the private unknowns of a group into the piece.
  bool eliminate_group(size_t g, const Room& at, double lambda, int worker, int& stacked) {
    const int k = groups[g].private_size, m = static_cast<int>(groups[g].columns.size()), width = stride(g);
    if (k == 0) return true;
    if (!factor_private(g, at, width, lambda)) return false;
    Worker& w = workers[worker];
    const int right_width = padded(m + 1);
    for (int i = 0; i < k; ++i) std::copy_n(at.rows + static_cast<size_t>(i) * width + k, m + 1, w.right.data() + i * right_width);
    kernels().solve_rows(at.factor, k, k + kSlack, w.right.data(), m + 1, right_width);
    if (!system.stacks()) {
      if (system.in_blocks())
        system.subtract_blocks(static_cast<int>(g), w.right.data(), right_width, aligned(w.eliminated), w.eliminated_gradient.data());
      else
        system.subtract(static_cast<int>(g), w.right.data(), k, right_width, w.eliminated.data(), w.eliminated_gradient.data());
      return true;
    }
    const int* column = groups[g].columns.data();
    for (int i = 0; i < k; ++i, ++stacked) {
      double* to = w.stack.data() + static_cast<size_t>(stacked) * system.ld();
      const double* from = w.right.data() + static_cast<size_t>(i) * right_width;
      std::fill_n(to, n, 0.0);
      for (int j = 0; j < m; ++j) to[column[j]] = from[j];
      to[n] = from[m];
    }
    if (stacked >= kStackedRows) multiply(worker, stacked);
    return true;
  }
  void multiply(int worker, int& stacked) {
    kernels().subtract_product(workers[worker].eliminated.data(), n + 1, system.ld(), workers[worker].stack.data(), stacked, system.ld());
    stacked = 0;
  }

  /// Marquardt's scales: the squared column norms, but never far below the first ones.
  static double scale_of(double norm, double& first_scale, bool first) {
    if (first || first_scale == 0) first_scale = norm;
    return std::max(norm, 1e-6 * first_scale);
  }

  enum class Assembly { fine, undefined, indefinite };

  /// The damped reduced system at `state`. With `linearise` the normal equations are new; without, only the damping is.
  Assembly assemble(const VectorXd& state, double lambda, bool linearise, bool first_scales, Cost& cost) {
    if (linearise) {
      problem.prepare(state);
      std::fill(shared_matrix.begin(), shared_matrix.end(), 0.0);
      shared_gradient.setZero();
      cost = {};
    }
    std::fill(damped_matrix.begin(), damped_matrix.end(), 0.0);
    std::fill(eliminated_blocks.begin(), eliminated_blocks.end(), 0.0);
    reduced_gradient.setZero();
    const bool fresh = linearise || light;
    turn = 0;
    over(pieces, [&](Piece& p, int worker) {
      Worker& w = workers[worker];
      p.defined = p.definite = true;
      if (fresh) {
        p.cost = {};
        light ? std::fill(w.shared.begin(), w.shared.end(), 0.0) : system.clear(w.shared.data());
        w.gradient.setZero();
      }
      system.in_blocks() ? std::fill(w.eliminated.begin(), w.eliminated.end(), 0.0) : system.clear(w.eliminated.data());
      w.eliminated_gradient.setZero();
      int stacked = 0;
      for (int first = p.first; first < p.last && p.defined; first += Problem::kRange) {
        const int last = std::min(p.last, first + Problem::kRange);
        if (fresh && !linearise_range(p, first, last, state, worker)) p.defined = false;
        for (int g = first; g < last && p.defined; ++g) {
          const Room at = room(g, first, worker);
          if (linearise)
            for (int i = 0; i < groups[g].private_size; ++i) {
              const int place = stores[g].private_start + i;
              private_scale(place) = scale_of(at.rows[static_cast<size_t>(i) * stride(g) + i], first_private_scale(place), first_scales);
            }
          p.definite = p.definite && eliminate_group(g, at, lambda, worker, stacked);
        }
      }
      if (stacked > 0) multiply(worker, stacked);
      // Pieces are taken in order, so the one whose turn it is is always at work.
      const int piece = static_cast<int>(&p - pieces.data());
      while (turn.load(std::memory_order_acquire) != piece) std::this_thread::yield();
      if (linearise) {
        if (light)
          kernels().add(shared_matrix.data(), w.shared.data(), static_cast<std::ptrdiff_t>(shared_matrix.size()));
        else
          system.accumulate(shared_matrix.data(), w.shared.data());
        shared_gradient += w.gradient;
        cost.twice += p.cost.twice;
        cost.chi2 += p.cost.chi2;
      }
      if (system.in_blocks())
        kernels().add(aligned(eliminated_blocks), aligned(w.eliminated), static_cast<std::ptrdiff_t>(eliminated_blocks.size()) - kSlack);
      else
        system.accumulate(damped_matrix.data(), w.eliminated.data());
      reduced_gradient += w.eliminated_gradient;
      turn.store(piece + 1, std::memory_order_release);
    });
    bool defined = true, definite = true;
    for (const Piece& p : pieces) {
      defined = defined && p.defined;
      definite = definite && p.definite;
    }
    if (linearise) {
      const std::ptrdiff_t* origin = light ? system.diagonal_origin() : system.origin();
      for (int i = 0; i < n; ++i) shared_scale(i) = scale_of(shared_matrix[origin[i] + i], first_shared_scale(i), first_scales);
    }
    if (!defined || !std::isfinite(cost.twice)) return Assembly::undefined;
    if (!definite) return Assembly::indefinite;
    if (system.in_blocks()) system.add_blocks(damped_matrix.data(), aligned(eliminated_blocks));
    if (light)
      system.add_diagonal_blocks(damped_matrix.data(), shared_matrix.data());
    else
      system.accumulate(damped_matrix.data(), shared_matrix.data());
    reduced_gradient += shared_gradient;
    if (system.stacks())
      for (int i = 0; i < n; ++i) reduced_gradient(i) += damped_matrix[system.origin()[i] + n], damped_matrix[system.origin()[i] + n] = 0;
    for (int i = 0; i < n; ++i) system.add_to_diagonal(damped_matrix.data(), i, shared_scale(i) > 0 ? lambda * shared_scale(i) : 1.0);
    return Assembly::fine;
  }

  /// Step of the assembled system at damping lambda; promised decrease of twice the cost and length in standard deviations.
  bool step(const VectorXd& state, double lambda, double& promised, double& length) {
    if (!system.factor(damped_matrix.data())) return false;
    for (int i = 0; i < n; ++i) right_side[i] = -reduced_gradient(i);
    system.solve(damped_matrix.data(), right_side.data());
    for (int i = 0; i < n; ++i) shared_step(i) = right_side[i];
    double slope = shared_gradient.dot(shared_step), damping = 0;
    for (int i = 0; i < n; ++i) damping += lambda * shared_scale(i) * shared_step(i) * shared_step(i);
    over(fine_pieces, [&](Piece& p, int worker) {
      p.slope = p.damping = 0;
      p.definite = true;
      for (int first = p.first; first < p.last; first += Problem::kRange) {
        const int last = std::min(p.last, first + Problem::kRange);
        if (light) substitute_light(p, first, last, state, lambda, worker);
        for (int g = first; g < last && !light; ++g) substitute(p, g, room(g, first, worker), lambda, worker);
      }
    });
    for (const Piece& p : fine_pieces) {
      if (!p.definite) return false;
      slope += p.slope;
      damping += p.damping;
    }
    promised = -slope + damping;
    length = std::sqrt(std::max(0.0, -slope - damping));
    return std::isfinite(promised) && shared_step.allFinite() && private_step.allFinite();
  }

  void substitute(Piece& p, size_t g, const Room& at, double lambda, int worker) {
    const int k = groups[g].private_size, m = static_cast<int>(groups[g].columns.size());
    double* d = workers[worker].solution.data();
    const int* column = groups[g].columns.data();
    for (int i = 0; i < k; ++i) {
      const double* row = at.rows + static_cast<size_t>(i) * stride(g) + k;
      double total = row[m];
      for (int j = 0; j < m; ++j) total += row[j] * shared_step(column[j]);
      d[i] = -total;
    }
    private_steps(p, g, at.factor, at.rows + k + m, stride(g), d, lambda);
  }
  /// The same from [P | a | a + Q dx] that the problem computes again.
  /// The same for groups of a range, from [P | a | a + Q dx] that the problem computes again.
  void substitute_light(Piece& p, int first, int last, const VectorXd& state, double lambda, int worker) {
    Worker& w = workers[worker];
    problem.condense(first, last, state, shared_step, worker, w.rows.data());
    double* group = w.rows.data();
    for (int g = first; g < last; ++g) {
      const int k = groups[g].private_size, width = k + 2;
      p.definite = factor_private(g, {group, w.factor.data()}, width, lambda) && p.definite;
      for (int i = 0; i < k; ++i) w.solution[i] = -group[static_cast<size_t>(i) * width + k + 1];
      private_steps(p, g, w.factor.data(), group + k, width, w.solution.data(), lambda);
      group += static_cast<size_t>(k) * width;
    }
  }
  /// Steps of a group from d = -(a + Q dx); a: numbers `width` apart.
  void private_steps(Piece& p, size_t g, const double* factor, const double* a, int width, double* d, double lambda) {
    const int k = groups[g].private_size, start = stores[g].private_start;
    kernels().solve_lower(factor, k, k + kSlack, d);
    kernels().solve_lower_transposed(factor, k, k + kSlack, d);
    for (int i = 0; i < k; ++i) {
      private_step(start + i) = d[i];
      p.slope += a[static_cast<size_t>(i) * width] * d[i];
      p.damping += lambda * private_scale(start + i) * d[i] * d[i];
    }
  }

  /// Anderson acceleration of the tail. With residuals that are large, or covariances that follow the parameters, plain steps f
  /// shrink by a fixed factor only. From the last few steps (f_j found, x_j taken) the combination gamma with least
  /// |f - sum gamma_j (f_j+1 - f_j)| (in the damping's metric) predicts where the sequence ends:  x = f - sum gamma_j (x_j + f_j+1 - f_j).
  /// Replaces shared_step and private_step; false if there is nothing to go by yet or the combination is no good.
  bool accelerate() {
    const int m = remembered;
    VectorXd& f = found[m];
    f.head(n) = shared_step;
    f.tail(private_size) = private_step;
    for (int j = 0; j < m; ++j) change.col(j) = found[j + 1] - found[j];
    if (m == 0) return false;
    for (int j = 0; j < m; ++j) {
      weighted.col(j).head(n) = shared_scale.cwiseProduct(change.col(j).head(n));
      weighted.col(j).tail(private_size) = private_scale.cwiseProduct(change.col(j).tail(private_size));
    }
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMemory, kMemory> normal(m, m);
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMemory, 1> right(m);
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < m; ++j) normal(i, j) = change.col(i).dot(weighted.col(j));
      right(i) = weighted.col(i).dot(f);
    }
    normal.diagonal() *= 1 + 1e-10;
    const Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMemory, 1> gamma = normal.ldlt().solve(right);
    if (!gamma.allFinite() || gamma.cwiseAbs().maxCoeff() > 50) return false;
    for (int j = 0; j < m; ++j) {
      shared_step -= gamma(j) * (taken[j].head(n) + change.col(j).head(n));
      private_step -= gamma(j) * (taken[j].tail(private_size) + change.col(j).tail(private_size));
    }
    return true;
  }
  void remember_taken() {
    taken[remembered].head(n) = shared_step;
    taken[remembered].tail(private_size) = private_step;
    if (remembered < kMemory) {
      ++remembered;
      return;
    }
    std::rotate(taken.begin(), taken.begin() + 1, taken.end());  // swaps the vectors' pointers
    std::rotate(found.begin(), found.begin() + 1, found.end());
  }
  void forget() { remembered = 0; }

  Problem& problem;
  SolverOptions options;
  int n, private_size = 0, widest = 0;  // widest: most shared columns of a group
  double rows = 0;
  const std::vector<GroupShape>& groups;
  const bool light;
  ReducedSystem system;
  Crew crew;
  std::vector<Piece> pieces, fine_pieces;
  std::atomic<int> turn{0};  // piece whose sums are added next
  std::vector<GroupStore> stores;
  std::unique_ptr<double[]> group_rows, group_factors;
  std::vector<Worker> workers;
  std::vector<int> identity;
  std::vector<std::ptrdiff_t> block_origin;
  std::vector<double> shared_matrix, damped_matrix, eliminated_blocks, right_side;
  VectorXd shared_gradient, reduced_gradient, shared_step, private_step;
  VectorXd shared_scale, private_scale, first_shared_scale, first_private_scale;
  VectorXd moved;
  SolveSummary summary;
  std::vector<double> sizes;
  std::vector<VectorXd> found, taken;  // steps found and taken, `remembered` of them
  int remembered = 0;
  VectorXd plain;  // the step before its acceleration
  MatrixXd change, weighted;
};

LevenbergMarquardt::LevenbergMarquardt(Problem& problem, SolverOptions options)
    : w_(std::make_unique<Workspace>(problem, std::move(options))) {}
LevenbergMarquardt::~LevenbergMarquardt() = default;
const char* LevenbergMarquardt::linear_solver() const { return w_->system.name(); }

const SolveSummary& LevenbergMarquardt::solve(VectorXd& state) {
  Workspace& w = *w_;
  SolveSummary& summary = w.summary;
  summary.outcome = Outcome::not_converged;
  summary.iterations = 0;
  summary.cost = {};
  summary.undefined_group = -1;
  summary.history.clear();
  summary.history.reserve(w.options.max_iterations + 1);
  bool fresh = true;  // covariances were evaluated at this very state
  const bool renewable = w.problem.renew(state);
  double lambda = 1e-4, growth = 10;
  w.sizes.clear();
  w.sizes.reserve(w.options.max_iterations + 1);
  w.forget();
  w.moved.resize(state.size());
  using Assembly = Workspace::Assembly;
  for (bool first = true;; first = false) {
    Assembly assembly = w.assemble(state, lambda, true, first, summary.cost);
    if (assembly == Assembly::undefined) {  // trial states were evaluated before: only the start can be undefined
      summary.outcome = Outcome::undefined_start;
      for (size_t g = 0; g < w.groups.size() && summary.undefined_group < 0; ++g) {
        Cost c;
        if (!w.problem.evaluate(static_cast<int>(g), state, 0, c)) summary.undefined_group = static_cast<int>(g);
      }
      return summary;
    }
    if (first) summary.history.push_back({summary.cost.chi2, lambda});
    const double twice = summary.cost.twice;
    if (twice <= 1e-18 * w.rows) {
      summary.outcome = Outcome::converged;
      return summary;
    }
    if (summary.iterations >= w.options.max_iterations) return summary;
    double promised = 0, length = 0;
    Cost trial;
    bool accepted = false, accelerated = false;
    const auto try_step = [&] {
      w.problem.retract(state, w.shared_step, w.private_step, w.moved);
      return w.evaluate(w.moved, trial) && (trial.twice < twice || promised <= 10 * kRoundingShare * twice || length < kConvergedStep);
    };
    while (!accepted) {
      if (assembly == Assembly::fine && w.step(state, lambda, promised, length)) {
        if (lambda <= kUndamped && length > kConvergedStep && !w.light) {
          w.plain.head(w.n) = w.shared_step;
          w.plain.tail(w.private_size) = w.private_step;
          accelerated = w.accelerate();
          accepted = try_step();
          if (!accepted && accelerated) {
            accelerated = false;
            w.forget();
            w.shared_step = w.plain.head(w.n);
            w.private_step = w.plain.tail(w.private_size);
            accepted = try_step();
          } else if (accepted) {
            w.remember_taken();
          }
        } else {
          accepted = try_step();
        }
      }
      if (accepted) break;
      w.forget();
      lambda = std::max(lambda, 1e-7) * growth;
      growth = std::min(growth * 2, 1e4);
      if (lambda > 1e14) return summary;
      assembly = w.assemble(state, lambda, false, false, summary.cost);
    }
    growth = 10;
    const double gain = promised > 0 && !accelerated ? (twice - trial.twice) / promised : 1;
    const bool rounding = promised <= kRoundingShare * twice;
    const double used = lambda;
    if (std::abs(gain - 1) < kFaithful || promised <= 10 * kRoundingShare * twice)
      lambda = std::max(lambda / 30, kSmallestDamping);
    else  // Nielsen
      lambda = std::max(lambda * std::max(1.0 / 3, 1 - std::pow(2 * gain - 1, 3)), kSmallestDamping);
    std::swap(state, w.moved);
    const bool little = w.options.relative_decrease > 0 && twice - trial.twice <= w.options.relative_decrease * twice;
    summary.cost = trial;
    ++summary.iterations;
    summary.history.push_back({trial.chi2, used});
    if (w.options.progress && !w.options.progress(summary.iterations, trial.chi2, used)) {
      summary.outcome = Outcome::cancelled;
      return summary;
    }
    bool still = false;
    if (used <= kUndamped) {
      w.sizes.push_back(rounding ? length : kInfinity);
      still = length < kConvergedStep || settled(w.sizes);
    }
    if (little || (still && (fresh || !renewable))) {
      summary.outcome = Outcome::converged;
      return summary;
    }
    fresh = false;
    if (renewable && (length < 1 || promised < 1e-4 * twice)) {
      w.problem.renew(state);
      fresh = true;
    }
  }
}

void LevenbergMarquardt::reduced(const VectorXd& state, MatrixXd& matrix, VectorXd& gradient) {
  Workspace& w = *w_;
  Cost cost;
  matrix.setZero(w.n, w.n);
  gradient.setZero(w.n);
  if (w.assemble(state, 0, true, true, cost) != Workspace::Assembly::fine) return;
  gradient = w.reduced_gradient;
  matrix = w.system.full(w.damped_matrix.data());
}

}  // namespace kincal
