#include "levenberg_marquardt.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "elimination.h"
#include "reduced_system.h"

namespace kincal {
namespace {

constexpr double kInfinity = std::numeric_limits<double>::infinity();
// Newton decrement, standard deviations: for up to a hundred groups, and a tenth of it times the
// root of their number for more, each of which has its share (else iterations grow with samples).
constexpr double kConverged = 1e-7;
constexpr double kNegligible =
    1e-10;  // damping: keeps directions without information where they are, biases nothing else
constexpr double kRounding = 1e-12;    // of a whitened residual, standard deviations
constexpr double kSummed = 1e-14;      // of the cost: residuals of much smaller noise than real
constexpr int kStalled = 3;            // iterations without a decrement of half of the best before
constexpr double kFaithful = 0.03;     // from 1: a gain that allows to give up damping fast
constexpr int kPatience = 6;           // steps near the minimum before curvature is looked for, and
constexpr int kPatienceShare = 8;      // not before this part of the linearisations it costs
constexpr int kMemory = 5;             // steps that the acceleration looks back
constexpr int kParts = 4;              // of an undamped step: all, a quarter, ...
constexpr double kExplained = 10;      // chi2 a row: below it residuals are about as large as noise
constexpr double kExtrapolated = 1e4;  // largest coefficient of an acceleration

/// The first group whose residual is undefined; where none is, and only the sum of all costs
/// overflows, that of the largest cost.
int worst_group(const Problem& problem, const VectorXd& state) {
  int worst = 0;
  double largest = 0;
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    Cost c;
    if (!problem.evaluate(static_cast<int>(g), state, 0, c) || std::isnan(c.doubled))
      return static_cast<int>(g);
    if (c.doubled > largest) {
      largest = c.doubled;
      worst = static_cast<int>(g);
    }
  }
  return worst;
}

}  // namespace

struct LevenbergMarquardt::Workspace {
  using Assembly = Arrowhead::Assembly;

  Workspace(Problem& problem, SolverOptions o)
      : options(std::move(o)), arrowhead(problem, options.linear_solver, options.threads) {
    if (arrowhead.ranges) return;
    for (auto* vectors : {&found, &taken})  // (not filled: solve() allocates nothing, and most
      for (VectorXd& v : *vectors)          // of them are never used)
        v.resize(arrowhead.n + arrowhead.private_size);
  }

  /// Adds a run of unknowns, from `first` on, to the normal equations of the combination. The
  /// changes f_j+1 - f_j are made piece by piece: kept, they would be as large as the steps
  /// themselves.
  template <class Matrix, class Vector>
  void add_changes(const VectorXd& scale, Eigen::Index first, int m, Matrix& normal,
                   Vector& right) const {
    constexpr Eigen::Index kPiece = 256;
    Eigen::Matrix<double, kPiece, kMemory> change, weighted;
    for (Eigen::Index at = 0; at < scale.size(); at += kPiece) {
      const Eigen::Index size = std::min(kPiece, scale.size() - at);
      for (int j = 0; j < m; ++j) {
        change.col(j).head(size) =
            found[j + 1].segment(first + at, size) - found[j].segment(first + at, size);
        weighted.col(j).head(size) = scale.segment(at, size).cwiseProduct(change.col(j).head(size));
      }
      for (int i = 0; i < m; ++i) {
        for (int j = 0; j < m; ++j)
          normal(i, j) += change.col(i).head(size).dot(weighted.col(j).head(size));
        right(i) += weighted.col(i).head(size).dot(found[m].segment(first + at, size));
      }
    }
  }

  /// Anderson acceleration. From the last few points (f_j the undamped step there, x_j the step
  /// that was taken) the combination gamma with least |f - sum gamma_j (f_j+1 - f_j)| (in the
  /// damping's metric) predicts where f vanishes:  x = f - sum gamma_j (x_j + f_j+1 - f_j).
  /// Replaces shared_step and private_step; false if there is nothing to go by yet or the
  /// combination is no good.
  bool accelerate() {
    const int m = remembered;
    VectorXd& f = found[m];
    f.head(arrowhead.n) = arrowhead.shared_step;
    f.tail(arrowhead.private_size) = arrowhead.private_step;
    if (m == 0) return false;
    Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, kMemory, kMemory> normal;
    Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMemory, 1> right;
    normal.setZero(m, m);
    right.setZero(m);
    add_changes(arrowhead.shared_scale, 0, m, normal, right);
    add_changes(arrowhead.private_scale, arrowhead.n, m, normal, right);
    normal.diagonal() *= 1 + 1e-10;
    const Eigen::Matrix<double, Eigen::Dynamic, 1, 0, kMemory, 1> gamma =
        normal.ldlt().solve(right);
    if (!gamma.allFinite() || gamma.cwiseAbs().maxCoeff() > kExtrapolated) return false;
    for (int j = 0; j < m; ++j) {
      const Eigen::Index n = arrowhead.n, k = arrowhead.private_size;
      arrowhead.shared_step -=
          gamma(j) * (taken[j].head(n) + found[j + 1].head(n) - found[j].head(n));
      arrowhead.private_step -=
          gamma(j) * (taken[j].tail(k) + found[j + 1].tail(k) - found[j].tail(k));
    }
    return true;
  }
  /// Called when a step was taken, of whatever damping, from where the undamped one is the last in
  /// `found`.
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
  /// Nothing is remembered but the undamped step that was found last.
  void forget() {
    std::swap(found[0], found[remembered]);
    remembered = 0;
  }

  /// What one iteration found out.
  struct Trial {
    Cost cost;
    double promised = 0, length = 0;  // of the step without acceleration
    double damping = 0;
    double decrement = kInfinity;  // length of the undamped step
    bool accelerated = false;
  };
  /// What the cost does not resolve: |r| |error of r|, and its own digits.
  double rounding(double doubled) const {
    return kRounding * std::sqrt(doubled * arrowhead.rows) + kSummed * doubled;
  }
  /// Moves to the step's end; true if it may be kept: what rounding could hide is no increase.
  bool accepts(const VectorXd& state, double doubled, Trial& trial) {
    arrowhead.problem.retract(state, arrowhead.shared_step, arrowhead.private_step, moved);
    const bool at_once = linearises_at_once(doubled, trial);
    const bool defined =
        at_once ? arrowhead.linearise(moved, trial.cost) : arrowhead.evaluate(moved, trial.cost);
    const bool accepted = defined && (trial.cost.doubled < doubled + 10 * rounding(doubled) ||
                                      trial.decrement < converged);
    if (at_once) linearised = accepted ? Linearised::moved : Linearised::nowhere;
    hopeful = accepted && (hopeful || first_trial);
    first_trial = false;
    return accepted;
  }
  /// A step that will be accepted and is not the last is linearised at its end, which gives its
  /// cost as well. One that was rejected after all costs a linearisation: then the trials only
  /// evaluate, until the first trial of an iteration is accepted again. Near the minimum the
  /// covariances are renewed before anything is linearised.
  bool linearises_at_once(double doubled, const Trial& trial) const {
    return hopeful && linearised == Linearised::here && !arrowhead.ranges &&
           !(renewable && is_near(trial, doubled)) && !arrowhead.has_curvature() &&
           trial.decrement >= converged && trial.promised > options.relative_decrease * doubled;
  }
  /// assemble() at `state`, linearised again if need be.
  Assembly assemble(const VectorXd& state, double lambda, bool first) {
    const bool linearise = linearised != Linearised::here;
    linearised = Linearised::here;
    return arrowhead.assemble(state, lambda, linearise, first, summary.cost);
  }
  /// Tries the undamped step of the assembled system: accelerated, as it is, and a share of it;
  /// true if `moved` may be kept.
  bool try_newton(const VectorXd& state, double doubled, Trial& trial) {
    if (!arrowhead.step(state, kNegligible, trial.promised, trial.length)) return false;
    trial.damping = kNegligible;
    trial.decrement = trial.length;
    if (arrowhead.ranges) return accepts(state, doubled, trial);
    trial.accelerated = accelerate() && trial.decrement > converged;
    if (trial.accelerated) {
      if (accepts(state, doubled, trial)) return true;
      trial.accelerated = false;
      forget();
    }
    const VectorXd& f = found[remembered];
    double share = 1;
    const int parts = doubled > kExplained * arrowhead.rows ? kParts : 1;
    for (int part = 0; part < parts; ++part, share /= 4) {
      arrowhead.shared_step = share * f.head(arrowhead.n);
      arrowhead.private_step = share * f.tail(arrowhead.private_size);
      if (accepts(state, doubled, trial) &&
          (part == 0 || doubled - trial.cost.doubled > 0.1 * share * trial.promised))
        return true;
    }
    return false;
  }
  /// Second derivatives cost a linearisation a column, an ordinary step about two: before they are
  /// looked for steps have cost a quarter as much.
  int first_patience() const {
    return std::max(kPatience, (arrowhead.n + arrowhead.deepest) / kPatienceShare);
  }
  void tell() const {
    const auto& [chi2, damping] = summary.history.back();
    options.progress.iteration(summary.iterations, chi2, damping);
  }
  /// Second derivatives are looked for where undamped steps go on and on near the minimum. Each
  /// time has to wait twice as long.
  void find_curvature(const VectorXd& state) {
    if (wait-- > 0 || !arrowhead.bends()) return;
    linearised = Linearised::nowhere;
    if (!arrowhead.find_curvature(state, [this] { tell(); })) return;
    wait = patience *= 2;
    forget();
  }
  /// The same as try_newton(), without second derivatives: with them it led nowhere.
  bool try_without_curvature(const VectorXd& state, double doubled, Trial& trial) {
    arrowhead.forget_curvature();
    forget();
    linearised = Linearised::nowhere;
    return assemble(state, kNegligible, false) == Assembly::fine &&
           try_newton(state, doubled, trial);
  }
  /// Raises the damping until a step is accepted; false if none is. `assembled`: the system is
  /// there at this damping.
  bool find_step(const VectorXd& state, double doubled, bool assembled, double& lambda,
                 Trial& trial) {
    double growth = 10;
    for (;; lambda = std::max(lambda, 1e-9) * growth, growth = std::min(growth * 2, 1e4)) {
      if (lambda > 1e14) return false;
      if (!assembled && assemble(state, lambda, false) != Assembly::fine) continue;
      assembled = false;
      trial.damping = lambda;
      if (arrowhead.step(state, lambda, trial.promised, trial.length) &&
          accepts(state, doubled, trial))
        return true;
    }
  }
  /// The damping after an accepted step. Undamped steps and gains that are rounding say nothing.
  double next_damping(double lambda, double doubled, const Trial& trial) const {
    if (trial.damping <= kNegligible || trial.promised <= 100 * rounding(doubled)) return lambda;
    const double gain = (doubled - trial.cost.doubled) / trial.promised;
    if (std::abs(gain - 1) < kFaithful) return std::max(lambda / 30, kNegligible);
    return std::max(lambda * std::max(1.0 / 3, 1 - std::pow(2 * gain - 1, 3)),
                    kNegligible);  // Nielsen
  }
  /// Close enough to the minimum for undamped steps. A RangeProblem linearises again for a second
  /// damping: it tries them where nothing but the test of the end is left to do.
  bool is_near(const Trial& trial, double doubled) const {
    if (arrowhead.ranges)
      return trial.length * trial.length <= std::max(converged * converged, rounding(doubled));
    return trial.damping <= kNegligible || trial.length < 1 || trial.promised < 1e-2 * doubled;
  }
  /// True where nothing moves any more, or rounding hides whether anything does.
  bool stationary(double decrement, double doubled) {
    if (decrement < converged) return true;
    ++stalled;
    if (decrement < best / 2) {
      best = decrement;
      stalled = 0;
    }
    return stalled >= kStalled && decrement * decrement <= rounding(doubled);
  }

  /// LevenbergMarquardt::solve(). @throws Cancelled
  void solve(VectorXd& state);

  /// Where the normal equations are that the arrowhead holds: at the present state, at the end of
  /// the step that was accepted, or elsewhere.
  enum class Linearised { here, moved, nowhere };

  SolverOptions options;
  Arrowhead arrowhead;
  VectorXd moved;
  Linearised linearised = Linearised::nowhere;
  bool renewable = false;   // covariances depend on the state
  bool hopeful = true;      // the last first trial was accepted
  bool first_trial = true;  // of this iteration
  SolveSummary summary;
  double best = kInfinity;  // decrement that later ones must halve
  int stalled = 0;          // iterations since
  double converged = kConverged * std::max(1.0, 0.1 * std::sqrt(arrowhead.problem.groups().size()));
  int patience = kPatience, wait = kPatience;
  /// Undamped steps and steps that were taken instead, `remembered` of them; of the first the
  /// present one besides.
  std::array<VectorXd, kMemory + 1> found, taken;
  int remembered = 0;
};

LevenbergMarquardt::LevenbergMarquardt(Problem& problem, SolverOptions options)
    : w_(std::make_unique<Workspace>(problem, std::move(options))) {}
LevenbergMarquardt::~LevenbergMarquardt() = default;
const char* LevenbergMarquardt::linear_solver() const { return w_->arrowhead.system.name(); }

void LevenbergMarquardt::reserve(Eigen::Index state_size) {
  w_->arrowhead.reserve_curvature(state_size);
}

const SolveSummary& LevenbergMarquardt::solve(VectorXd& state) {
  try {
    w_->solve(state);
  } catch (const Cancelled&) {
    w_->summary.outcome = Outcome::cancelled;
  }
  return w_->summary;
}

void LevenbergMarquardt::Workspace::solve(VectorXd& state) {
  Problem& problem = arrowhead.problem;
  summary.outcome = Outcome::not_converged;
  summary.iterations = 0;
  summary.cost = {};
  summary.undefined_group = -1;
  summary.history.clear();
  summary.history.reserve(options.max_iterations + 1);
  renewable = problem.renew(state);
  linearised = Linearised::nowhere;
  hopeful = true;
  bool near = options.near_minimum;  // undamped steps come first, covariances are fresh
  double lambda = near ? kNegligible : 1e-4;
  best = kInfinity;
  stalled = remembered = 0;
  patience = wait = first_patience();
  arrowhead.forget_curvature();
  moved.resize(state.size());
  for (bool first = true;; first = false) {
    if (near && options.second_derivatives) find_curvature(state);
    const Assembly assembly = assemble(state, near ? kNegligible : lambda, first);
    first_trial = true;
    if (assembly == Assembly::undefined) {  // trial states were evaluated before: only the start
                                            // can be undefined
      summary.outcome = Outcome::undefined_start;
      summary.undefined_group = worst_group(problem, state);
      return;
    }
    if (first) summary.history.push_back({summary.cost.chi2, lambda});
    const double doubled = summary.cost.doubled;
    if (doubled <= 1e-18 * arrowhead.rows) {
      summary.outcome = Outcome::converged;
      return;
    }
    if (summary.iterations >= options.max_iterations) return;
    const bool fine = assembly == Assembly::fine;
    Trial trial;
    bool accepted = near && fine && try_newton(state, doubled, trial);
    if (!accepted && arrowhead.has_curvature())
      accepted = try_without_curvature(state, doubled, trial);
    if (!accepted) {
      if (near && lambda <= kNegligible) lambda = 1e-6;
      accepted = find_step(state, doubled, fine && !near, lambda, trial);
    }
    const bool at_rest = near && options.stop && stationary(trial.decrement, doubled);
    if (!accepted) {
      if (at_rest) summary.outcome = Outcome::converged;
      return;
    }
    if (trial.decrement < kInfinity && !arrowhead.ranges)
      remember_taken();
    else
      remembered = 0;
    lambda = next_damping(lambda, doubled, trial);
    std::swap(state, moved);
    linearised = linearised == Linearised::moved ? Linearised::here : Linearised::nowhere;
    const bool little = options.relative_decrease > 0 &&
                        doubled - trial.cost.doubled <= options.relative_decrease * doubled;
    summary.cost = trial.cost;
    ++summary.iterations;
    summary.history.push_back({trial.cost.chi2, trial.damping});
    tell();
    if (little || at_rest) {
      summary.outcome = Outcome::converged;
      return;
    }
    const bool was_near = near;
    near = is_near(trial, doubled);
    if (near && !was_near) lambda = kNegligible;
    if (near && renewable) problem.renew(state);
  }
}

void LevenbergMarquardt::reduced(const VectorXd& state, MatrixXd& matrix, VectorXd& gradient) {
  Arrowhead& a = w_->arrowhead;
  Cost cost;
  matrix.setZero(a.n, a.n);
  gradient.setZero(a.n);
  if (a.assemble(state, 0, true, true, cost) != Arrowhead::Assembly::fine) return;
  gradient = a.reduced_gradient();
  matrix = a.system.full(a.damped_matrix().data());
}

}  // namespace kincal
