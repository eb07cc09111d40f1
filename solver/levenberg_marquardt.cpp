#include "levenberg_marquardt.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "threads.h"

namespace kincal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kConvergedStep = 1e-7;     // standard deviations
constexpr double kSmallestDamping = 1e-10;  // keeps directions without information where they are, biases nothing else
constexpr double kUndamped = 1e-9;          // up to here a step's length means distance to the minimum
constexpr double kRoundingShare = 1e-12;    // of the cost: what is promised below it may be rounding
constexpr int kMemory = 3;                  // steps that the acceleration looks back
constexpr int kPieces = 16;                 // of the partition, whatever the number of threads

/// What one group keeps between linearisation and substitution.
struct GroupStore {
  MatrixXd rows;    // [P Q a], private_size x (size + 1)
  MatrixXd factor;  // Cholesky factor L of the damped P, in the lower triangle
  MatrixXd right;   // B = L^-1 [Q a]
  int private_start = 0;
};

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
        system(n, groups, options.linear_solver),
        crew(std::max(1, options.threads)) {
    problem.set_workers(crew.size());
    int largest = 0;
    stores.resize(groups.size());
    for (size_t g = 0; g < groups.size(); ++g) {
      const int size = groups[g].size(), k = groups[g].private_size;
      largest = std::max(largest, size + 1);
      stores[g].rows.resize(k, size + 1);
      stores[g].factor.resize(k, k);
      stores[g].right.resize(k, size + 1 - k);
      stores[g].private_start = private_size;
      private_size += k;
      rows += groups[g].rows;
    }
    // Contiguous pieces of about equal work (rows and columns), the same for any number of threads.
    double total = 0, sum = 0;
    const auto work = [](const GroupShape& g) { return g.rows * 20.0 + g.size() * g.size(); };
    for (const GroupShape& g : groups) total += work(g);
    piece_start.push_back(0);
    for (size_t g = 0; g < groups.size(); ++g) {
      sum += work(groups[g]);
      if (sum * kPieces >= total * piece_start.size() && piece_start.size() < kPieces) piece_start.push_back(static_cast<int>(g) + 1);
    }
    if (piece_start.back() != static_cast<int>(groups.size())) piece_start.push_back(static_cast<int>(groups.size()));
    const size_t pieces = piece_start.size() - 1;
    accumulators.assign(pieces, std::vector<double>(system.storage(), 0.0));
    vectors.assign(pieces, VectorXd::Zero(n));
    costs.resize(pieces);
    fine.resize(pieces);
    grams.assign(crew.size(), MatrixXd(largest, largest));
    blocks.assign(crew.size(), MatrixXd(largest, largest));
    shared_matrix.assign(system.storage(), 0.0);
    damped_matrix.assign(system.storage(), 0.0);
    shared_gradient.setZero(n);
    reduced_gradient.setZero(n);
    shared_step.setZero(n);
    private_step.setZero(private_size);
    shared_scale.setZero(n);
    private_scale.setZero(private_size);
    first_shared_scale.setZero(n);
    first_private_scale.setZero(private_size);
  }

  /// Runs work(group, piece, worker) over all groups; the sums by piece are then added in the pieces' order.
  template <class Work>
  void over_groups(const Work& work) {
    crew.run(static_cast<int>(piece_start.size()) - 1, [&](int piece, int worker) {
      for (int g = piece_start[piece]; g < piece_start[piece + 1]; ++g) work(g, piece, worker);
    });
  }

  bool evaluate(const VectorXd& state, Cost& cost) {
    std::fill(costs.begin(), costs.end(), Cost());
    std::fill(fine.begin(), fine.end(), 1);
    over_groups([&](int g, int piece, int worker) {
      Cost c;
      if (fine[piece] && !problem.evaluate(g, state, worker, c)) fine[piece] = 0;
      costs[piece].twice += c.twice;
      costs[piece].chi2 += c.chi2;
    });
    cost = {};
    for (const Cost& c : costs) cost.twice += c.twice, cost.chi2 += c.chi2;
    return std::find(fine.begin(), fine.end(), 0) == fine.end() && std::isfinite(cost.twice);
  }

  /// Normal equations at `state`: private rows into the stores, C and b summed.
  bool linearise(const VectorXd& state, Cost& cost) {
    problem.prepare(state);
    std::fill(costs.begin(), costs.end(), Cost());
    std::fill(fine.begin(), fine.end(), 1);
    for (size_t p = 0; p < accumulators.size(); ++p) {
      std::fill(accumulators[p].begin(), accumulators[p].end(), 0.0);
      vectors[p].setZero();
    }
    over_groups([&](int g, int piece, int worker) {
      const int size = groups[g].size(), k = groups[g].private_size, m = size - k;
      auto gram = grams[worker].topLeftCorner(size + 1, size + 1);
      gram.setZero();
      Cost c;
      if (fine[piece] && !problem.linearise(g, state, worker, gram, c)) fine[piece] = 0;
      costs[piece].twice += c.twice;
      costs[piece].chi2 += c.chi2;
      stores[g].rows.leftCols(k) = gram.topLeftCorner(k, k).template selfadjointView<Eigen::Lower>();
      stores[g].rows.rightCols(m + 1) = gram.bottomLeftCorner(m + 1, k).transpose();
      system.add(g, gram.block(k, k, m, m), accumulators[piece].data());
      for (int i = 0; i < m; ++i) vectors[piece](groups[g].columns[i]) += gram(size, k + i);
    });
    std::fill(shared_matrix.begin(), shared_matrix.end(), 0.0);
    shared_gradient.setZero();
    cost = {};
    for (size_t p = 0; p < accumulators.size(); ++p) {
      for (size_t i = 0; i < shared_matrix.size(); ++i) shared_matrix[i] += accumulators[p][i];
      shared_gradient += vectors[p];
      cost.twice += costs[p].twice;
      cost.chi2 += costs[p].chi2;
    }
    return std::find(fine.begin(), fine.end(), 0) == fine.end() && std::isfinite(cost.twice);
  }

  /// Marquardt's scales: the squared column norms, but never far below the first ones.
  void scale(bool first) {
    const auto update = [&](double norm, double& first_scale) {
      if (first || first_scale == 0) first_scale = norm;
      return std::max(norm, 1e-6 * first_scale);
    };
    for (int i = 0; i < n; ++i) shared_scale(i) = update(system.diagonal(shared_matrix.data(), i), first_shared_scale(i));
    for (size_t g = 0; g < groups.size(); ++g)
      for (int i = 0, at = stores[g].private_start; i < groups[g].private_size; ++i, ++at)
        private_scale(at) = update(stores[g].rows(i, i), first_private_scale(at));
  }

  /// Eliminates the private blocks with damping lambda and sums the reduced system into damped_matrix, reduced_gradient.
  /// False if a block is not positive definite to rounding.
  bool eliminate(double lambda) {
    std::fill(fine.begin(), fine.end(), 1);
    for (size_t p = 0; p < accumulators.size(); ++p) {
      std::fill(accumulators[p].begin(), accumulators[p].end(), 0.0);
      vectors[p].setZero();
    }
    over_groups([&](int g, int piece, int worker) {
      GroupStore& s = stores[g];
      const int k = groups[g].private_size, m = groups[g].size() - k;
      if (k == 0) return;
      s.factor = s.rows.leftCols(k);
      for (int i = 0; i < k; ++i) {
        const double scale = private_scale(s.private_start + i);
        s.factor(i, i) += scale > 0 ? lambda * scale : 1.0;  // a column of zeros: its step is 0
      }
      Eigen::Ref<MatrixXd> in_place(s.factor);
      if (Eigen::LLT<Eigen::Ref<MatrixXd>>(in_place).info() != Eigen::Success) {
        fine[piece] = 0;
        return;
      }
      s.right = s.rows.rightCols(m + 1);
      s.factor.triangularView<Eigen::Lower>().solveInPlace(s.right);
      auto block = blocks[worker].topLeftCorner(m + 1, m + 1);
      block.setZero();
      block.template selfadjointView<Eigen::Lower>().rankUpdate(s.right.transpose());
      system.add(g, block, accumulators[piece].data());
      for (int i = 0; i < m; ++i) vectors[piece](groups[g].columns[i]) += block(m, i);
    });
    if (std::find(fine.begin(), fine.end(), 0) != fine.end()) return false;
    damped_matrix = shared_matrix;
    reduced_gradient = shared_gradient;
    for (size_t p = 0; p < accumulators.size(); ++p) {
      for (size_t i = 0; i < damped_matrix.size(); ++i) damped_matrix[i] -= accumulators[p][i];
      reduced_gradient -= vectors[p];
    }
    for (int i = 0; i < n; ++i) system.add_diagonal(damped_matrix.data(), i, shared_scale(i) > 0 ? lambda * shared_scale(i) : 1.0);
    return true;
  }

  /// Step at damping lambda; promised decrease of twice the cost and length in standard deviations.
  bool step(double lambda, double& promised, double& length) {
    if (!eliminate(lambda) || !system.factor(damped_matrix.data())) return false;
    shared_step = -reduced_gradient;
    system.solve(shared_step);
    double slope = shared_gradient.dot(shared_step), damping = 0;
    for (int i = 0; i < n; ++i) damping += lambda * shared_scale(i) * shared_step(i) * shared_step(i);
    for (size_t g = 0; g < groups.size(); ++g) {
      GroupStore& s = stores[g];
      const int k = groups[g].private_size, m = groups[g].size() - k;
      if (k == 0) continue;
      auto d = private_step.segment(s.private_start, k);
      d = -s.right.col(m);
      for (int i = 0; i < m; ++i) d -= shared_step(groups[g].columns[i]) * s.right.col(i);
      s.factor.triangularView<Eigen::Lower>().adjoint().solveInPlace(d);
      slope += s.rows.col(k + m).dot(d);
      for (int i = 0; i < k; ++i) damping += lambda * private_scale(s.private_start + i) * d(i) * d(i);
    }
    promised = -slope + damping;
    length = std::sqrt(std::max(0.0, -slope - damping));
    return std::isfinite(promised) && shared_step.allFinite() && private_step.allFinite();
  }

  /// Anderson acceleration of the tail. With residuals that are large, or covariances that follow the parameters, plain steps f
  /// shrink by a fixed factor only. From the last few steps (f_j found, x_j taken) the combination gamma with least
  /// |f - sum gamma_j (f_j+1 - f_j)| (in the damping's metric) predicts where the sequence ends:  x = f - sum gamma_j (x_j + f_j+1 - f_j).
  /// Replaces shared_step and private_step; false if there is nothing to go by yet or the combination is no good.
  bool accelerate() {
    VectorXd f(n + private_size), scale(n + private_size);
    f << shared_step, private_step;
    scale << shared_scale, private_scale;
    const Eigen::Index m = static_cast<Eigen::Index>(found.size());
    MatrixXd change(f.size(), m);
    for (Eigen::Index j = 0; j < m; ++j) change.col(j) = (j + 1 < m ? found[j + 1] : f) - found[j];
    found.push_back(f);
    if (m == 0) return false;
    const MatrixXd weighted = scale.asDiagonal() * change;
    MatrixXd normal = change.transpose() * weighted;
    normal.diagonal() *= 1 + 1e-10;
    const VectorXd gamma = normal.ldlt().solve(weighted.transpose() * f);
    if (!gamma.allFinite() || gamma.cwiseAbs().maxCoeff() > 50) return false;
    for (Eigen::Index j = 0; j < m; ++j) f -= gamma(j) * (taken[j] + change.col(j));
    shared_step = f.head(n);
    private_step = f.tail(private_size);
    return true;
  }
  void remember_taken() {
    VectorXd x(n + private_size);
    x << shared_step, private_step;
    taken.push_back(x);
    if (taken.size() > kMemory) {
      taken.erase(taken.begin());
      found.erase(found.begin());
    }
  }
  void forget() {
    found.clear();
    taken.clear();
  }

  Problem& problem;
  SolverOptions options;
  int n, private_size = 0;
  double rows = 0;
  const std::vector<GroupShape>& groups;
  ReducedSystem system;
  Crew crew;
  std::vector<int> piece_start;
  std::vector<GroupStore> stores;
  std::vector<std::vector<double>> accumulators;
  std::vector<VectorXd> vectors;
  std::vector<Cost> costs;
  std::vector<char> fine;
  std::vector<MatrixXd> grams, blocks;  // per worker
  std::vector<double> shared_matrix, damped_matrix;
  VectorXd shared_gradient, reduced_gradient, shared_step, private_step;
  VectorXd shared_scale, private_scale, first_shared_scale, first_private_scale;
  VectorXd moved;
  std::vector<double> sizes;
  std::vector<VectorXd> found, taken;
};

LevenbergMarquardt::LevenbergMarquardt(Problem& problem, SolverOptions options)
    : w_(std::make_unique<Workspace>(problem, std::move(options))) {}
LevenbergMarquardt::~LevenbergMarquardt() = default;
const char* LevenbergMarquardt::linear_solver() const { return w_->system.name(); }

SolveSummary LevenbergMarquardt::solve(VectorXd& state) {
  Workspace& w = *w_;
  SolveSummary summary;
  bool fresh = true;  // covariances were evaluated at this very state
  const bool renewable = w.problem.renew(state);
  double lambda = 1e-4, growth = 10;
  w.sizes.clear();
  w.forget();
  w.moved.resize(state.size());
  for (bool first = true;; first = false) {
    if (!w.linearise(state, summary.cost)) {  // trial states were evaluated before: only the start can be undefined
      summary.outcome = Outcome::undefined_start;
      for (size_t g = 0; g < w.groups.size() && summary.undefined_group < 0; ++g) {
        Cost c;
        if (!w.problem.evaluate(static_cast<int>(g), state, 0, c)) summary.undefined_group = static_cast<int>(g);
      }
      return summary;
    }
    if (first) summary.history.push_back({summary.cost.chi2, lambda});
    w.scale(first);
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
      if (w.step(lambda, promised, length)) {
        if (lambda <= kUndamped && length > kConvergedStep) {
          const VectorXd plain_shared = w.shared_step, plain_private = w.private_step;
          accelerated = w.accelerate();
          accepted = try_step();
          if (!accepted && accelerated) {
            accelerated = false;
            w.forget();
            w.shared_step = plain_shared;
            w.private_step = plain_private;
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
    }
    growth = 10;
    const double gain = promised > 0 && !accelerated ? (twice - trial.twice) / promised : 1;
    const bool rounding = promised <= kRoundingShare * twice;
    const double used = lambda;
    if (gain > 0.75 || promised <= 10 * kRoundingShare * twice)
      lambda = std::max(lambda / 30, kSmallestDamping);
    else if (gain > 0.25)
      lambda = std::max(lambda / 3, kSmallestDamping);
    else
      lambda *= 2;
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
  w.linearise(state, cost);
  w.scale(true);
  matrix.setZero(w.n, w.n);
  gradient.setZero(w.n);
  if (!w.eliminate(0)) return;
  gradient = w.reduced_gradient;
  matrix = w.system.full(w.damped_matrix.data());
}

}  // namespace kincal
