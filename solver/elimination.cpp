#include "elimination.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <thread>

#include "kernels.h"

namespace kincal {
namespace {

constexpr int kPieces = 16, kFewPieces = 2;  // of the partition, whatever the number of threads
constexpr double kSmallMove = 1e-3;          // of a difference of gradients, standard deviations,
constexpr double kLargestMove = 1e-5;        // and at most so far in the unknown's unit
constexpr int kStackedRows = 64;             // eliminated rows that are multiplied at once
// An addition to a place of the reduced system costs as much as so many products of a stack.
constexpr double kAddition = 10;

/// Marquardt's scales: the squared column norms, but never far below the first ones.
double scale_of(double norm, double& first_scale, bool first) {
  if (first || first_scale == 0) first_scale = norm;
  return std::max(norm, 1e-6 * first_scale);
}

/// The turn of a piece to add its sums, which passes to the next one when this ends, also by an
/// exception: the others wait for it. Pieces of a share are taken in order, so the one whose turn
/// it is is always at work.
struct Turn {
  std::atomic<int>& turn;
  const int piece;

  void await() const {
    while (turn.load(std::memory_order_acquire) != piece) std::this_thread::yield();
  }
  ~Turn() {
    await();
    turn.store(piece + 1, std::memory_order_release);
  }
};

}  // namespace

Arrowhead::Arrowhead(Problem& p, LinearSolver linear_solver, int threads)
    : problem(p),
      ranges(dynamic_cast<const RangeProblem*>(&p)),
      n(p.shared_size()),
      groups(p.groups()),
      system(n, groups, linear_solver, {ranges != nullptr, p.prior_group()}),
      pool(std::max(1, threads)) {
  problem.set_workers(pool.size());
  size_t rows_size = 0, largest_rows = 0;
  stores.resize(groups.size());
  for (size_t g = 0; g < groups.size(); ++g) {
    const int k = groups[g].private_size;
    stores[g] = {rows_size, private_size};
    const size_t r = static_cast<size_t>(k) * stride(g);
    rows_size += r;
    largest_rows = std::max(largest_rows, r);
    if (static_cast<int>(g) != p.prior_group())
      widest = std::max(widest, static_cast<int>(groups[g].columns.size()));
    deepest = std::max(deepest, k);
    private_size += k;
    rows += groups[g].rows;
  }
  // They are not filled: the thread that works on a group touches its memory first.
  if (!ranges) group_rows.reset(new double[rows_size + kSlack]);
  place_pieces();
  if (system.stacks()) place_stacks();
  for (int i = 0; i < std::max(widest, n); ++i) {
    identity.push_back(i);
    block_origin.push_back(static_cast<std::ptrdiff_t>(i) * widest);
  }
  workers.resize(pool.size());
  for (Worker& w : workers) {
    w.sums.shared.resize(ranges ? system.diagonal_storage() + kSlack : system.storage());
    w.sums.eliminated.resize(system.in_blocks() ? system.block_storage() : system.storage());
    w.sums.gradient.setZero(n);
    w.sums.eliminated_gradient.setZero(n);
    if (ranges) w.rows.resize(largest_rows * RangeProblem::kRange + kSlack);
    w.factor.resize(static_cast<size_t>(deepest) * (deepest + kSlack) + kSlack);
    w.right.resize(static_cast<size_t>(std::max(deepest, 1)) * padded(widest + 1) + kSlack);
    if (!stacks.empty()) {
      const Stack& last = stacks.back();
      w.stacked.resize(last.first_row + static_cast<size_t>(kStackedRows + deepest) * last.ld +
                       kSlack);
      w.stack_sums.resize(last.first_sum + static_cast<size_t>(last.width()) * last.ld + kSlack);
      w.height.assign(stacks.size(), 0);
    }
    w.touched.resize(widest);
    if (!system.dense() && !ranges) w.block.resize(static_cast<size_t>(widest) * widest);
    w.solution.resize(deepest + kSlack);
  }
  shares =
      std::vector<Share>(std::min(pieces.size(), static_cast<size_t>(ThreadPool::kMostShares)));
  for (size_t s = 0; s < shares.size(); ++s) {
    shares[s].first = ThreadPool::first_of(static_cast<int>(s), static_cast<int>(pieces.size()),
                                           static_cast<int>(shares.size()));
    shares[s].sums = workers[0].sums;
  }
  // Dense arrays may be read up to their slack: zero once.
  if (system.in_blocks()) whole_matrix.assign(system.storage(), 0.0);
  for (VectorXd* v : {&shared_step, &shared_scale, &first_shared_scale}) v->setZero(n);
  for (VectorXd* v : {&private_step, &private_scale, &first_private_scale, &factor_diagonal})
    v->setZero(private_size);
  right_side.assign(n + kSlack, 0.0);
}

/// Contiguous pieces of about equal work (rows and columns), the same for any number of threads.
void Arrowhead::place_pieces() {
  const auto eliminating = [](const GroupShape& g) {
    const double m = static_cast<double>(g.columns.size());
    return 20.0 * g.rows + 0.012 * g.private_size * m * m;
  };
  double total = 0;
  for (const GroupShape& g : groups) total += eliminating(g);
  // Each has matrices to be added up: as many as keep that small beside the rest.
  const double storage =
      static_cast<double>(system.in_blocks() ? system.block_storage() : system.storage());
  int most = kPieces;
  while (most > kFewPieces && total < 16 * most * storage) most /= 2;
  pieces = partition(most, eliminating);
  fine_pieces = partition(kPieces, [](const GroupShape& g) { return g.rows + 5.0; });
}

/// A stack for each set of columns that enough rows have: what they save against rows over all
/// columns must be worth adding the products to their places, once a piece.
void Arrowhead::place_stacks() {
  std::map<std::vector<int>, double> eliminated;  // rows, by the columns
  for (const GroupShape& g : groups)
    if (g.private_size > 0) eliminated[g.columns] += g.private_size;
  std::map<std::vector<int>, int> place;
  const auto add = [&](const std::vector<int>& columns) {
    const auto [it, is_new] = place.insert({columns, static_cast<int>(stacks.size())});
    if (!is_new) return it->second;
    Stack stack;
    stack.columns = columns;
    stack.columns.push_back(n);
    stack.whole = stack.width() == n + 1;
    stack.ld = stack.whole ? system.ld() : padded(stack.width()) + kSlack;
    if (!stacks.empty()) {
      const Stack& last = stacks.back();
      stack.first_row = last.first_row + static_cast<size_t>(kStackedRows + deepest) * last.ld;
      stack.first_sum =
          last.first_sum + static_cast<size_t>(last.whole ? 0 : last.width()) * last.ld;
    }
    stacks.push_back(std::move(stack));
    return it->second;
  };
  std::vector<int> all(n);
  for (int i = 0; i < n; ++i) all[i] = i;
  const double whole = static_cast<double>(n) * n;
  stack_of.assign(groups.size(), -1);
  for (size_t g = 0; g < groups.size(); ++g) {
    if (groups[g].private_size == 0) continue;
    const double m = static_cast<double>(groups[g].columns.size()) + 1,
                 rows_of_piece = eliminated[groups[g].columns] / static_cast<double>(pieces.size());
    const bool own = rows_of_piece * (whole - m * m) > kAddition * m * m;
    stack_of[g] = add(own ? groups[g].columns : all);
  }
}

template <class Work>
std::vector<Piece> Arrowhead::partition(int most, const Work& work) const {
  double total = 0, sum = 0;
  for (const GroupShape& g : groups) total += work(g);
  std::vector<Piece> out(1);
  for (size_t g = 0; g < groups.size(); ++g) {
    sum += work(groups[g]);
    out.back().last = static_cast<int>(g) + 1;
    if (sum * most < total * out.size() || out.size() == static_cast<size_t>(most) ||
        g + 1 == groups.size())
      continue;
    out.emplace_back();
    out.back().first = static_cast<int>(g) + 1;
  }
  return out;
}

/// Runs work(piece, worker) over all pieces, of the partition for matrices or of the finer one for
/// sums of numbers.
template <class Work>
void Arrowhead::over(std::vector<Piece>& partition, const Work& work) {
  pool.run(static_cast<int>(partition.size()),
           static_cast<int>(&partition == &pieces ? shares.size() : ThreadPool::kMostShares),
           [&](int piece, int worker) { work(partition[piece], worker); });
}

/// evaluate() of a piece's groups, summed; false where a residual is undefined.
bool Arrowhead::evaluate_each(Piece& p, const VectorXd& state, int worker) const {
  Cost one;
  for (int g = p.first; g < p.last; ++g) {
    if (!problem.evaluate(g, state, worker, one)) return false;
    p.cost.doubled += one.doubled;
    p.cost.chi2 += one.chi2;
  }
  return true;
}

bool Arrowhead::evaluate(const VectorXd& state, Cost& cost) {
  problem.prepare(state);
  over(fine_pieces, [&](Piece& p, int worker) {
    p.cost = {};
    p.defined = ranges ? ranges->evaluate_range(p.first, p.last, state, worker, p.cost)
                       : evaluate_each(p, state, worker);
  });
  cost = {};
  bool defined = true;
  for (const Piece& p : fine_pieces) {
    cost.doubled += p.cost.doubled;
    cost.chi2 += p.cost.chi2;
    defined = defined && p.defined;
  }
  return defined && std::isfinite(cost.doubled);
}

/// Where the rows of a group are, which is of the range that begins with `first`.
double* Arrowhead::rows_of(size_t g, int first, int worker) {
  return ranges ? workers[worker].rows.data() + (stores[g].rows - stores[first].rows)
                : group_rows.get() + stores[g].rows;
}

/// Equations of groups first .. last - 1 (of one range): rows to their arrays, C and b to the
/// worker's.
bool Arrowhead::linearise_range(Piece& p, int first, int last, const VectorXd& state, int worker) {
  Worker& w = workers[worker];
  if (ranges) ranges->prepare_range(first, last, state, worker);
  for (int g = first; g < last; ++g) {
    const int k = groups[g].private_size;
    double* rows_of_group = rows_of(g, first, worker);
    std::fill_n(rows_of_group, static_cast<size_t>(k) * stride(g), 0.0);
    GroupEquations to{rows_of_group,
                      stride(g),
                      w.sums.shared.data(),
                      system.origin(),
                      groups[g].columns.data(),
                      w.sums.gradient.data()};
    const bool local = !system.dense() && !ranges && g != problem.prior_group();
    const size_t m = groups[g].columns.size();
    if (ranges) to.origin = system.diagonal_origin();
    if (local) {
      std::fill_n(w.block.begin(), m * widest, 0.0);
      std::fill_n(w.right.begin(), m, 0.0);
      to.shared = w.block.data();
      to.origin = block_origin.data();
      to.row = identity.data();
      to.gradient = w.right.data();
    }
    Cost c;
    if (!problem.linearise(g, state, worker, to, c)) return false;
    p.cost.doubled += c.doubled;
    p.cost.chi2 += c.chi2;
    if (!local) continue;
    system.add(g, w.block.data(), widest, w.sums.shared.data());
    for (size_t i = 0; i < m; ++i) w.sums.gradient(groups[g].columns[i]) += w.right[i];
  }
  return true;
}

/// Factors the damped private block of a group, whose rows are `width` apart, in the worker's
/// scratch; false if it is not positive definite to rounding.
bool Arrowhead::factor_private(size_t g, const double* group, int width, double lambda,
                               int worker) {
  double* factor = workers[worker].factor.data();
  const int k = groups[g].private_size, ld = k + kSlack;
  for (int j = 0; j < k; ++j)
    for (int i = j; i < k; ++i)
      factor[i + static_cast<size_t>(j) * ld] = group[static_cast<size_t>(j) * width + i];
  for (int i = 0; i < k; ++i) {
    const double scale = private_scale(stores[g].private_start + i);
    factor[i + static_cast<size_t>(i) * ld] +=
        scale > 0 ? lambda * scale : 1.0;  // a column of zeros: its step is 0
  }
  return kernels().cholesky(factor, k, ld);
}

/// Keeps the worker's factor in the group's rows, for the substitution: what is below the diagonal
/// of its column j in row k - 1 - j, which has as many numbers below the diagonal of P.
void Arrowhead::keep_factor(size_t g, double* group, int worker) {
  const int k = groups[g].private_size, ld = k + kSlack, width = stride(g);
  const double* from = workers[worker].factor.data();
  double* to = group + static_cast<std::ptrdiff_t>(k - 1) * width;
  for (int j = 0; j < k; ++j, from += ld + 1, to -= width) {
    factor_diagonal(stores[g].private_start + j) = from[0];
    for (int i = 1; i < k - j; ++i) to[i - 1] = from[i];
  }
}

void Arrowhead::fetch_factor(size_t g, const double* group, int worker) {
  const int k = groups[g].private_size, ld = k + kSlack, width = stride(g);
  const double* from = group + static_cast<std::ptrdiff_t>(k - 1) * width;
  double* to = workers[worker].factor.data();
  for (int j = 0; j < k; ++j, from -= width, to += ld + 1) {
    to[0] = factor_diagonal(stores[g].private_start + j);
    for (int i = 1; i < k - j; ++i) to[i] = from[i - 1];
  }
}

/// Eliminates the private unknowns of a group into the piece.
bool Arrowhead::eliminate_group(size_t g, double* group, double lambda, int worker) {
  const int k = groups[g].private_size, m = static_cast<int>(groups[g].columns.size()),
            width = stride(g);
  if (k == 0) return true;
  if (!factor_private(g, group, width, lambda, worker)) return false;
  if (!ranges) keep_factor(g, group, worker);
  if (!stacks.empty()) {
    eliminate_onto(stacks[stack_of[g]], g, group, worker);
    return true;
  }
  Worker& w = workers[worker];
  const int right_width = padded(m + 1);
  for (int i = 0; i < k; ++i)
    std::copy_n(group + static_cast<size_t>(i) * width + k, m + 1,
                w.right.data() + i * right_width);
  kernels().solve_rows(w.factor.data(), k, k + kSlack, w.right.data(), m + 1, right_width);
  if (system.in_blocks())
    system.subtract_blocks(static_cast<int>(g), w.right.data(), right_width,
                           w.sums.eliminated.data(), w.sums.eliminated_gradient.data());
  else
    system.subtract(static_cast<int>(g), w.right.data(), k, right_width, w.sums.eliminated.data(),
                    w.sums.eliminated_gradient.data());
  return true;
}

/// Adds the group's eliminated rows to a stack, whose columns are the group's or all.
void Arrowhead::eliminate_onto(const Stack& stack, size_t g, const double* group, int worker) {
  Worker& w = workers[worker];
  const std::vector<int>& columns = groups[g].columns;
  const int k = groups[g].private_size, m = static_cast<int>(columns.size());
  int& height = w.height[stack_of[g]];
  double* top = w.stacked.data() + stack.first_row + static_cast<size_t>(height) * stack.ld;
  const bool same = m + 1 == stack.width();
  double* solved = same ? top : w.right.data();
  const int apart = same ? stack.ld : padded(m + 1);
  for (int i = 0; i < k; ++i)
    std::copy_n(group + static_cast<size_t>(i) * stride(g) + k, m + 1,
                solved + static_cast<std::ptrdiff_t>(i) * apart);
  kernels().solve_rows(w.factor.data(), k, k + kSlack, solved, m + 1, apart);
  for (int i = 0; i < k && !same; ++i) {
    double* to = top + static_cast<std::ptrdiff_t>(i) * stack.ld;
    const double* from = solved + static_cast<std::ptrdiff_t>(i) * apart;
    std::fill_n(to, n, 0.0);
    for (int j = 0; j < m; ++j) to[columns[j]] = from[j];
    to[n] = from[m];
  }
  height += k;
  if (height >= kStackedRows) multiply(stack_of[g], worker);
}

/// Subtracts the products of a stack's rows from its sums and empties it.
void Arrowhead::multiply(int index, int worker) {
  Worker& w = workers[worker];
  const Stack& stack = stacks[index];
  kernels().subtract_product(
      stack.whole ? w.sums.eliminated.data() : w.stack_sums.data() + stack.first_sum, stack.width(),
      stack.ld, w.stacked.data() + stack.first_row, w.height[index], stack.ld);
  w.height[index] = 0;
}

/// What eliminate_group() adds to, to zero.
void Arrowhead::clear_eliminated(int worker) {
  Worker& w = workers[worker];
  system.in_blocks() ? std::fill(w.sums.eliminated.begin(), w.sums.eliminated.end(), 0.0)
                     : system.clear(w.sums.eliminated.data());
  w.sums.eliminated_gradient.setZero();
  std::fill(w.height.begin(), w.height.end(), 0);
  for (const Stack& stack : stacks)
    for (int j = 0; j < stack.width() && !stack.whole; ++j)
      std::fill_n(
          w.stack_sums.begin() +
              static_cast<std::ptrdiff_t>(stack.first_sum + static_cast<size_t>(j) * stack.ld + j),
          stack.width() - j, 0.0);
}

/// Brings what the stacks hold to its places.
void Arrowhead::add_stacks(int worker) {
  Worker& w = workers[worker];
  for (size_t s = 0; s < stacks.size(); ++s) {
    const Stack& stack = stacks[s];
    if (w.height[s] > 0) multiply(static_cast<int>(s), worker);
    if (stack.whole) continue;
    const int* column = stack.columns.data();
    for (int j = 0; j + 1 < stack.width(); ++j) {
      const double* from =
          w.stack_sums.data() + stack.first_sum + static_cast<size_t>(j) * stack.ld;
      double* to = w.sums.eliminated.data() + system.origin()[column[j]];
#pragma GCC unroll 8
      for (int i = j; i < stack.width(); ++i) to[column[i]] += from[i];
    }
  }
}

/// Linearises or eliminates the groups of a piece, or both, and adds its sums when its turn comes.
void Arrowhead::pass_over(Piece& p, const VectorXd& state, const Pass& pass, int worker) {
  const int piece = static_cast<int>(&p - pieces.data());
  size_t share = shares.size() - 1;
  while (shares[share].first > piece) --share;
  const Turn mine{shares[share].turn, piece};
  Worker& w = workers[worker];
  p.defined = p.definite = true;
  const bool fresh = pass.linearise || ranges;
  if (fresh) {
    p.cost = {};
    ranges ? std::fill(w.sums.shared.begin(), w.sums.shared.end(), 0.0)
           : system.clear(w.sums.shared.data());
    w.sums.gradient.setZero();
  }
  if (pass.eliminate) clear_eliminated(worker);
  const bool in_pieces = pass.linearise && system.dense() && !ranges && n > 0;
  if (in_pieces) problem.begin_piece(worker);
  for (int first = p.first; first < p.last && p.defined; first += RangeProblem::kRange) {
    const int last = std::min(p.last, first + RangeProblem::kRange);
    if (fresh && !linearise_range(p, first, last, state, worker)) p.defined = false;
    for (int g = first; g < last && p.defined; ++g) {
      double* group = rows_of(g, first, worker);
      if (pass.linearise)
        for (int i = 0; i < groups[g].private_size; ++i) {
          const int place = stores[g].private_start + i;
          private_scale(place) = scale_of(group[static_cast<size_t>(i) * stride(g) + i],
                                          first_private_scale(place), pass.first_scales);
        }
      if (pass.linearise && curved)
        kernels().add(group, rows_curvature.data() + stores[g].rows,
                      static_cast<std::ptrdiff_t>(groups[g].private_size) * stride(g));
      if (pass.eliminate) p.definite = p.definite && eliminate_group(g, group, pass.lambda, worker);
    }
  }
  if (pass.eliminate) add_stacks(worker);
  if (in_pieces)
    problem.end_piece(worker, {nullptr, 0, w.sums.shared.data(), system.origin(), identity.data(),
                               w.sums.gradient.data()});
  mine.await();
  Sums& sums = shares[share].sums;
  if (piece != shares[share].first) return add_sums(sums, w.sums, pass);
  if (pass.linearise) {
    std::swap(sums.shared, w.sums.shared);
    std::swap(sums.gradient, w.sums.gradient);
  }
  if (pass.eliminate) {
    std::swap(sums.eliminated, w.sums.eliminated);
    std::swap(sums.eliminated_gradient, w.sums.eliminated_gradient);
  }
}

void Arrowhead::add_sums(Sums& to, const Sums& from, const Pass& pass) const {
  if (pass.linearise) {
    if (ranges)
      kernels().add(to.shared.data(), from.shared.data(),
                    static_cast<std::ptrdiff_t>(system.diagonal_storage()));
    else
      system.accumulate(to.shared.data(), from.shared.data());
    to.gradient += from.gradient;
  }
  if (!pass.eliminate) return;
  if (system.in_blocks())
    kernels().add(to.eliminated.data(), from.eliminated.data(),
                  static_cast<std::ptrdiff_t>(from.eliminated.size()) - kSlack);
  else
    system.accumulate(to.eliminated.data(), from.eliminated.data());
  to.eliminated_gradient += from.eliminated_gradient;
}

/// Adds the other shares' sums to those of the first one, which become the totals; blocks go to
/// their places at once, by all threads, for these are the larger part of bundle adjustment's sums.
void Arrowhead::add_shares(const Pass& pass) {
  Pass all_but_blocks = pass;
  if (system.in_blocks()) all_but_blocks.eliminate = false;
  for (size_t i = 1; i < shares.size(); ++i) {
    add_sums(totals(), shares[i].sums, all_but_blocks);
    if (pass.eliminate && system.in_blocks())
      totals().eliminated_gradient += shares[i].sums.eliminated_gradient;
  }
  if (!pass.eliminate || !system.in_blocks()) return;
  const double* sums[ThreadPool::kMostShares];
  for (size_t i = 0; i < shares.size(); ++i) sums[i] = shares[i].sums.eliminated.data();
  pool.run(kPieces, ThreadPool::kMostShares, [&](int piece, int) {
    system.put_blocks(whole_matrix.data(), sums, static_cast<int>(shares.size()), {piece, kPieces});
  });
}

/// A pass over all pieces, and what it leaves of the shared unknowns.
Arrowhead::Assembly Arrowhead::run(const VectorXd& state, const Pass& pass, Cost& cost) {
  if (pass.linearise) {
    problem.prepare(state);
    cost = {};
  }
  for (Share& share : shares) share.turn = share.first;
  over(pieces, [&](Piece& p, int worker) { pass_over(p, state, pass, worker); });
  add_shares(pass);
  bool defined = true, definite = true;
  for (const Piece& p : pieces) {
    if (pass.linearise) {
      cost.doubled += p.cost.doubled;
      cost.chi2 += p.cost.chi2;
    }
    defined = defined && p.defined;
    definite = definite && p.definite;
  }
  if (pass.linearise) {
    const std::ptrdiff_t* origin = ranges ? system.diagonal_origin() : system.origin();
    for (int i = 0; i < n; ++i)
      shared_scale(i) =
          scale_of(totals().shared[origin[i] + i], first_shared_scale(i), pass.first_scales);
  }
  if (pass.linearise && curved)
    kernels().add(totals().shared.data(), shared_curvature.data(),
                  static_cast<std::ptrdiff_t>(totals().shared.size()));
  if (!defined || !std::isfinite(cost.doubled)) return Assembly::undefined;
  return definite ? Assembly::fine : Assembly::indefinite;
}

bool Arrowhead::linearise(const VectorXd& state, Cost& cost) {
  return run(state, {true, false, false, 0}, cost) != Assembly::undefined;
}

/// The damped reduced system at `state`. With `linearise` the normal equations are new; without,
/// only the damping is.
Arrowhead::Assembly Arrowhead::assemble(const VectorXd& state, double lambda, bool linearise,
                                        bool first_scales, Cost& cost) {
  const Assembly assembly = run(state, {linearise, true, first_scales, lambda}, cost);
  if (assembly != Assembly::fine) return assembly;
  if (ranges)
    system.add_diagonal_blocks(damped_matrix().data(), totals().shared.data());
  else
    system.accumulate(damped_matrix().data(), totals().shared.data());
  totals().eliminated_gradient += totals().gradient;
  if (system.stacks())
    for (int i = 0; i < n; ++i)
      totals().eliminated_gradient(i) += damped_matrix()[system.origin()[i] + n],
          damped_matrix()[system.origin()[i] + n] = 0;
  for (int i = 0; i < n; ++i)
    system.add_to_diagonal(damped_matrix().data(), i,
                           shared_scale(i) > 0 ? lambda * shared_scale(i) : 1.0);
  return Assembly::fine;
}

/// Linearises where shared_step and private_step lead from `state`.
bool Arrowhead::linearise_beside(const VectorXd& state) {
  problem.retract(state, shared_step, private_step, beside);
  Cost cost;
  return linearise(beside, cost);
}

/// Column k of P's curvature of a group, from the step of its private unknown k.
void Arrowhead::bend_private(size_t g, int k) {
  const int size = groups[g].private_size, width = stride(g);
  const double h = k < size ? private_step(stores[g].private_start + k) : 0;
  if (h == 0) return;
  const double* now = group_rows.get() + stores[g].rows;
  const double* before = here.rows.data() + stores[g].rows;
  const size_t last = size + groups[g].columns.size();
  for (int i = 0; i < size; ++i) {
    const size_t a = static_cast<size_t>(i) * width + last;
    const size_t at = static_cast<size_t>(std::min(i, k)) * width + std::max(i, k);
    rows_curvature[stores[g].rows + at] +=
        (i == k ? 1 : 0.5) * ((now[a] - before[a]) / h - before[at]);
  }
}

/// Column k of Q's and C's curvature, from the step of shared unknown k.
void Arrowhead::bend_shared(int k) {
  const double h = shared_step(k);
  for (size_t g = 0; g < groups.size(); ++g) {
    const std::vector<int>& columns = groups[g].columns;
    const auto found = std::lower_bound(columns.begin(), columns.end(), k);
    if (found == columns.end() || *found != k) continue;
    const int size = groups[g].private_size, width = stride(g);
    const double* now = group_rows.get() + stores[g].rows;
    const double* before = here.rows.data() + stores[g].rows;
    for (int i = 0; i < size; ++i) {
      const size_t row = static_cast<size_t>(i) * width + size;
      const size_t a = row + columns.size(), at = row + (found - columns.begin());
      rows_curvature[stores[g].rows + at] = (now[a] - before[a]) / h - before[at];
    }
  }
  for (int i = 0; i < n; ++i) {
    const size_t at = system.origin()[std::min(i, k)] + std::max(i, k);
    shared_curvature[at] +=
        (i == k ? 1 : 0.5) * ((totals().gradient(i) - here.gradient(i)) / h - here.shared[at]);
  }
}

void Arrowhead::reserve_curvature(Eigen::Index state_size) {
  if (groups.empty()) return;
  const size_t rows_size = stores.back().rows + static_cast<size_t>(groups.back().private_size) *
                                                    stride(groups.size() - 1);
  here.rows.reserve(rows_size);
  here.shared.reserve(totals().shared.size());
  here.gradient.resize(totals().gradient.size());
  shared_move.resize(shared_scale.size());
  private_move.resize(private_scale.size());
  rows_curvature.reserve(rows_size + kSlack);
  shared_curvature.reserve(totals().shared.size());
  beside.resize(state_size);
}

bool Arrowhead::find_curvature(const VectorXd& state, const std::function<void()>& before_each) {
  curved = false;
  if (!bends()) return false;
  Cost cost;
  if (assemble(state, 1, true, false, cost) == Assembly::undefined) return false;
  const size_t rows_size = stores.back().rows + static_cast<size_t>(groups.back().private_size) *
                                                    stride(groups.size() - 1);
  here.rows.assign(group_rows.get(), group_rows.get() + rows_size);
  here.shared = totals().shared;
  here.gradient = totals().gradient;
  const auto small = [](double scale) {
    return scale > 0 ? std::min(kSmallMove / std::sqrt(scale), kLargestMove) : 0.0;
  };
  shared_move = shared_scale.unaryExpr(small);
  private_move = private_scale.unaryExpr(small);
  rows_curvature.assign(rows_size + kSlack, 0.0);
  shared_curvature.assign(totals().shared.size(), 0.0);
  beside.resize(state.size());
  shared_step.setZero();
  for (int k = 0; k < deepest; ++k) {
    private_step.setZero();
    for (size_t g = 0; g < groups.size(); ++g) {
      const int place = stores[g].private_start + k;
      if (k < groups[g].private_size) private_step(place) = private_move(place);
    }
    before_each();
    if (!linearise_beside(state)) return false;
    for (size_t g = 0; g < groups.size(); ++g) bend_private(g, k);
  }
  private_step.setZero();
  for (int k = 0; k < n; ++k) {
    if (shared_move(k) == 0) continue;
    shared_step.setZero();
    shared_step(k) = shared_move(k);
    before_each();
    if (!linearise_beside(state)) return false;
    bend_shared(k);
  }
  return curved = true;
}

/// Step of the assembled system at damping lambda; promised decrease of twice the cost and length
/// in standard deviations.
bool Arrowhead::step(const VectorXd& state, double lambda, double& promised, double& length) {
  if (!system.factor(damped_matrix().data(), pool)) return false;
  for (int i = 0; i < n; ++i) right_side[i] = -totals().eliminated_gradient(i);
  system.solve(damped_matrix().data(), right_side.data());
  for (int i = 0; i < n; ++i) shared_step(i) = right_side[i];
  double slope = totals().gradient.dot(shared_step), damping = 0;
  for (int i = 0; i < n; ++i) damping += lambda * shared_scale(i) * shared_step(i) * shared_step(i);
  over(fine_pieces, [&](Piece& p, int worker) {
    p.slope = p.damping = 0;
    p.definite = true;
    for (int first = p.first; first < p.last; first += RangeProblem::kRange) {
      const int last = std::min(p.last, first + RangeProblem::kRange);
      if (ranges) substitute_range(p, first, last, state, lambda, worker);
      for (int g = first; g < last && !ranges; ++g)
        substitute(p, g, rows_of(g, first, worker), lambda, worker);
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

void Arrowhead::substitute(Piece& p, size_t g, const double* group, double lambda, int worker) {
  const int k = groups[g].private_size, m = static_cast<int>(groups[g].columns.size());
  if (k == 0) return;
  fetch_factor(g, group, worker);
  double* d = workers[worker].solution.data();
  const int* column = groups[g].columns.data();
  double* touched = workers[worker].touched.data();
  for (int j = 0; j < m; ++j) touched[j] = shared_step(column[j]);
  for (int i = 0; i < k; ++i) {
    const double* row = group + static_cast<size_t>(i) * stride(g) + k;
    double totals[4] = {row[m], 0, 0, 0};  // sums that do not wait for each other
    int j = 0;
    for (; j + 4 <= m; j += 4)
      for (int q = 0; q < 4; ++q) totals[q] += row[j + q] * touched[j + q];
    for (; j < m; ++j) totals[0] += row[j] * touched[j];
    d[i] = -((totals[0] + totals[1]) + (totals[2] + totals[3]));
  }
  private_steps(p, g, {group + k + m, stride(g)}, lambda, worker);
}

/// substitute() for the groups of a range, from [P | a | a + Q dx] that the problem computes again.
void Arrowhead::substitute_range(Piece& p, int first, int last, const VectorXd& state,
                                 double lambda, int worker) {
  Worker& w = workers[worker];
  ranges->recompute_rows(first, last, state, shared_step, worker, w.rows.data());
  double* group = w.rows.data();
  for (int g = first; g < last; ++g) {
    const int k = groups[g].private_size, width = k + 2;
    p.definite = factor_private(g, group, width, lambda, worker) && p.definite;
    for (int i = 0; i < k; ++i) w.solution[i] = -group[static_cast<size_t>(i) * width + k + 1];
    private_steps(p, g, {group + k, width}, lambda, worker);
    group += static_cast<size_t>(k) * width;
  }
}

/// Steps of a group from d = -(a + Q dx), the worker's solution, and its factor.
void Arrowhead::private_steps(Piece& p, size_t g, const Column& a, double lambda, int worker) {
  const int k = groups[g].private_size, start = stores[g].private_start;
  const double* factor = workers[worker].factor.data();
  double* d = workers[worker].solution.data();
  kernels().solve_lower(factor, k, k + kSlack, d);
  kernels().solve_lower_transposed(factor, k, k + kSlack, d);
  for (int i = 0; i < k; ++i) {
    private_step(start + i) = d[i];
    p.slope += a.first[static_cast<size_t>(i) * a.stride] * d[i];
    p.damping += lambda * private_scale(start + i) * d[i] * d[i];
  }
}

}  // namespace kincal
