#include "levenberg_marquardt.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "elimination.h"

namespace kincal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
constexpr double kConvergedStep = 1e-7;  // standard deviations
constexpr double kSmallestDamping =
    1e-10;  // keeps directions without information where they are, biases nothing else
constexpr double kUndamped = 1e-9;  // up to here a step's length means distance to the minimum
constexpr double kRoundingShare = 1e-12;  // of the cost: what is promised below it may be rounding
constexpr double kFaithful = 0.03;        // from 1: a gain that allows to give up damping fast
constexpr int kMemory = 3;                // steps that the acceleration looks back

/// Five steps in a row, none of them half of an earlier one; infinite: a step that still promised
/// something.
bool settled(const std::vector<double>& sizes) {
  if (sizes.size() < 6) return false;
  double smallest_before = kInfinity, smallest = kInfinity, largest = 0;
  for (size_t i = 0; i + 5 < sizes.size(); ++i)
    smallest_before = std::min(smallest_before, sizes[i]);
  for (size_t i = sizes.size() - 6; i < sizes.size(); ++i) largest = std::max(largest, sizes[i]);
  for (size_t i = sizes.size() - 5; i < sizes.size(); ++i) smallest = std::min(smallest, sizes[i]);
  return largest < kInfinity && smallest > 0.5 * smallest_before;
}

}  // namespace

struct LevenbergMarquardt::Workspace {
  using Assembly = Arrowhead::Assembly;

  Workspace(Problem& problem, SolverOptions o)
      : options(std::move(o)), arrowhead(problem, options.linear_solver, options.threads) {
    if (arrowhead.ranges) return;
    const Eigen::Index unknowns = arrowhead.n + arrowhead.private_size;
    for (std::vector<VectorXd>* vectors : {&found, &taken})
      vectors->assign(kMemory + 1, VectorXd::Zero(unknowns));
    plain.setZero(unknowns);
    change.setZero(unknowns, kMemory);
    weighted.setZero(unknowns, kMemory);
  }

  /// Anderson acceleration of the tail. With residuals that are large, or covariances that follow
  /// the parameters, plain steps f shrink by a fixed factor only. From the last few steps (f_j
  /// found, x_j taken) the combination gamma with least |f - sum gamma_j (f_j+1 - f_j)| (in the
  /// damping's metric) predicts where the sequence ends:  x = f - sum gamma_j (x_j + f_j+1 - f_j).
  /// Replaces shared_step and private_step; false if there is nothing to go by yet or the
  /// combination is no good.
  bool accelerate() {
    const int m = remembered;
    VectorXd& f = found[m];
    f.head(arrowhead.n) = arrowhead.shared_step;
    f.tail(arrowhead.private_size) = arrowhead.private_step;
    for (int j = 0; j < m; ++j) change.col(j) = found[j + 1] - found[j];
    if (m == 0) return false;
    for (int j = 0; j < m; ++j) {
      weighted.col(j).head(arrowhead.n) =
          arrowhead.shared_scale.cwiseProduct(change.col(j).head(arrowhead.n));
      weighted.col(j).tail(arrowhead.private_size) =
          arrowhead.private_scale.cwiseProduct(change.col(j).tail(arrowhead.private_size));
    }
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMemory, kMemory> normal(m, m);
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMemory, 1> right(m);
    for (int i = 0; i < m; ++i) {
      for (int j = 0; j < m; ++j) normal(i, j) = change.col(i).dot(weighted.col(j));
      right(i) = weighted.col(i).dot(f);
    }
    normal.diagonal() *= 1 + 1e-10;
    const Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMemory, 1> gamma =
        normal.ldlt().solve(right);
    if (!gamma.allFinite() || gamma.cwiseAbs().maxCoeff() > 50) return false;
    for (int j = 0; j < m; ++j) {
      arrowhead.shared_step -=
          gamma(j) * (taken[j].head(arrowhead.n) + change.col(j).head(arrowhead.n));
      arrowhead.private_step -= gamma(j) * (taken[j].tail(arrowhead.private_size) +
                                            change.col(j).tail(arrowhead.private_size));
    }
    return true;
  }
  /// Called when the step was taken.
  void remember_taken() {
    taken[remembered].head(arrowhead.n) = arrowhead.shared_step;
    taken[remembered].tail(arrowhead.private_size) = arrowhead.private_step;
    if (remembered < kMemory) {
      ++remembered;
      return;
    }
    std::rotate(taken.begin(), taken.begin() + 1, taken.end());  // swaps the vectors' pointers
    std::rotate(found.begin(), found.begin() + 1, found.end());
  }
  void forget() { remembered = 0; }

  /// What one iteration found out.
  struct Trial {
    Cost cost;
    double promised = 0, length = 0;
    bool accelerated = false;
  };
  /// Moves to the step's end; true if it may be kept.
  bool accepts(const VectorXd& state, double doubled, Trial& trial) {
    arrowhead.problem.retract(state, arrowhead.shared_step, arrowhead.private_step, moved);
    return arrowhead.evaluate(moved, trial.cost) &&
           (trial.cost.doubled < doubled || trial.promised <= 10 * kRoundingShare * doubled ||
            trial.length < kConvergedStep);
  }
  /// Computes a step of the assembled system and tries it, first accelerated where that may help;
  /// true if `moved` may be kept.
  bool try_step(const VectorXd& state, double doubled, double lambda, Trial& trial) {
    if (!arrowhead.step(state, lambda, trial.promised, trial.length)) return false;
    if (!(lambda <= kUndamped && trial.length > kConvergedStep && !arrowhead.ranges))
      return accepts(state, doubled, trial);
    plain.head(arrowhead.n) = arrowhead.shared_step;
    plain.tail(arrowhead.private_size) = arrowhead.private_step;
    trial.accelerated = accelerate();
    if (accepts(state, doubled, trial)) {
      remember_taken();
      return true;
    }
    if (!trial.accelerated) return false;
    trial.accelerated = false;
    forget();
    arrowhead.shared_step = plain.head(arrowhead.n);
    arrowhead.private_step = plain.tail(arrowhead.private_size);
    return accepts(state, doubled, trial);
  }
  /// Raises the damping until a step is accepted; false if none is.
  bool find_step(const VectorXd& state, double doubled, Assembly assembly, double& lambda,
                 Trial& trial) {
    double growth = 10;
    while (!(assembly == Assembly::fine && try_step(state, doubled, lambda, trial))) {
      forget();
      lambda = std::max(lambda, 1e-7) * growth;
      growth = std::min(growth * 2, 1e4);
      if (lambda > 1e14) return false;
      assembly = arrowhead.assemble(state, lambda, false, false, summary.cost);
    }
    return true;
  }
  /// The damping after an accepted step.
  static double next_damping(double lambda, double doubled, const Trial& trial) {
    const double gain = trial.promised > 0 && !trial.accelerated
                            ? (doubled - trial.cost.doubled) / trial.promised
                            : 1;
    if (std::abs(gain - 1) < kFaithful || trial.promised <= 10 * kRoundingShare * doubled)
      return std::max(lambda / 30, kSmallestDamping);
    return std::max(lambda * std::max(1.0 / 3, 1 - std::pow(2 * gain - 1, 3)),
                    kSmallestDamping);  // Nielsen
  }

  SolverOptions options;
  Arrowhead arrowhead;
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
const char* LevenbergMarquardt::linear_solver() const { return w_->arrowhead.system.name(); }

const SolveSummary& LevenbergMarquardt::solve(VectorXd& state) {
  Workspace& w = *w_;
  Problem& problem = w.arrowhead.problem;
  SolveSummary& summary = w.summary;
  summary.outcome = Outcome::not_converged;
  summary.iterations = 0;
  summary.cost = {};
  summary.undefined_group = -1;
  summary.history.clear();
  summary.history.reserve(w.options.max_iterations + 1);
  bool fresh = true;  // covariances were evaluated at this very state
  const bool renewable = problem.renew(state);
  double lambda = 1e-4;
  w.sizes.clear();
  w.sizes.reserve(w.options.max_iterations + 1);
  w.forget();
  w.moved.resize(state.size());
  using Assembly = Workspace::Assembly;
  for (bool first = true;; first = false) {
    const Assembly assembly = w.arrowhead.assemble(state, lambda, true, first, summary.cost);
    if (assembly == Assembly::undefined) {  // trial states were evaluated before: only the start
                                            // can be undefined
      summary.outcome = Outcome::undefined_start;
      for (size_t g = 0; g < w.arrowhead.groups.size() && summary.undefined_group < 0; ++g) {
        Cost c;
        if (!problem.evaluate(static_cast<int>(g), state, 0, c))
          summary.undefined_group = static_cast<int>(g);
      }
      return summary;
    }
    if (first) summary.history.push_back({summary.cost.chi2, lambda});
    const double doubled = summary.cost.doubled;
    if (doubled <= 1e-18 * w.arrowhead.rows) {
      summary.outcome = Outcome::converged;
      return summary;
    }
    if (summary.iterations >= w.options.max_iterations) return summary;
    Workspace::Trial trial;
    if (!w.find_step(state, doubled, assembly, lambda, trial)) return summary;
    const bool rounding = trial.promised <= kRoundingShare * doubled;
    const double used = lambda;
    lambda = Workspace::next_damping(lambda, doubled, trial);
    std::swap(state, w.moved);
    const bool little = w.options.relative_decrease > 0 &&
                        doubled - trial.cost.doubled <= w.options.relative_decrease * doubled;
    summary.cost = trial.cost;
    ++summary.iterations;
    summary.history.push_back({trial.cost.chi2, used});
    if (w.options.progress && !w.options.progress(summary.iterations, trial.cost.chi2, used)) {
      summary.outcome = Outcome::cancelled;
      return summary;
    }
    bool stationary = false;
    if (used <= kUndamped) {
      w.sizes.push_back(rounding ? trial.length : kInfinity);
      stationary = trial.length < kConvergedStep || settled(w.sizes);
    }
    if (little || (stationary && (fresh || !renewable))) {
      summary.outcome = Outcome::converged;
      return summary;
    }
    fresh = false;
    if (renewable && (trial.length < 1 || trial.promised < 1e-4 * doubled)) {
      problem.renew(state);
      fresh = true;
    }
  }
}

void LevenbergMarquardt::reduced(const VectorXd& state, MatrixXd& matrix, VectorXd& gradient) {
  Arrowhead& a = w_->arrowhead;
  Cost cost;
  matrix.setZero(a.n, a.n);
  gradient.setZero(a.n);
  if (a.assemble(state, 0, true, true, cost) != Arrowhead::Assembly::fine) return;
  gradient = a.reduced_gradient;
  matrix = a.system.full(a.damped_matrix.data());
}

}  // namespace kincal
