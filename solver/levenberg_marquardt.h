// Levenberg-Marquardt on the arrowhead, by the Schur complement.
//
// With damping D = lambda diag(H) (Marquardt), every group's private block is eliminated by a small
// Cholesky,
//     P + D_p = L L',   B = L^-1 [Q | a],   S = C + D_x - sum B_Q' B_Q,   s = b - sum B_Q' B_a,
// then  S dx = -s  and  dp = -L^-T L^-1 (a + Q dx).
// With g the whole gradient and d the whole step, the quadratic model promises (in twice the cost)
//     promised = -g'd + lambda d'Dd,   and moves the residuals by   |J d|^2 = -g'd - lambda d'Dd,
// the length of the step in standard deviations: both cost nothing beyond the solution.
//
// Converged: the Newton decrement, the length |J d| of the undamped step at the point where it
// starts, is below 1e-7 standard deviations, whatever damping earlier steps needed; or it no longer
// halves and its square is below what the cost resolves (a whitened residual is accurate to 1e-12,
// so the cost to |r| |error of r| + 1e-14 |r|^2); or the residuals are zero (noise-free data).
//
// Far from the minimum steps are damped: Nielsen's update, but a thirtieth where the gain is within
// 3 % of 1. Near it (steps below one standard deviation, or that promise little, or undamped ones
// that were accepted) the undamped step is solved for first, which is what the decrement needs
// anyway; then these are tried until one lowers the cost: its Anderson acceleration, the step
// itself, damped steps. Before these, shares of it if residuals are larger than noise (it leads
// downhill; along a curved valley of the right model shares would creep). If the model cannot
// explain the residuals, the undamped step is poor: missing second derivatives make it too short,
// or so long that it raises the cost. The last few undamped steps and the actual path of the
// iteration show the missing part, whichever step was taken. If this takes long (six steps, more
// with many shared columns), second derivatives are computed by differences of gradients, a
// linearisation for each column, once and then after twice as many steps each time: S = H - J'WJ,
// column by column, is added to the linearisation until steps with it fail to lower the cost.
// Covariances that depend on the state are renewed after each step near the minimum: the point
// where nothing moves, J'(x) W(x) r(x) = 0, is the same as that of complete minimisations in turn.
// Where a step is likely to be accepted and not the last one, its end is linearised at once, which
// gives the cost and is the next iteration's linearisation; after a rejected one trials evaluate
// only, and a rejected step repeats the elimination, not the linearisation (a RangeProblem: both,
// and it always evaluates; there only the test of the end is undamped). Groups are partitioned by
// the problem's size alone, each worker sums one piece at a time, and pieces are added in their
// order to shares, these to the totals: the result is the same to the last bit for any number of
// threads.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "problem.h"
#include "progress.h"

namespace kincal {

enum class Outcome { converged, not_converged, undefined_start, cancelled };

struct SolverOptions {
  int max_iterations = 200;
  int threads = 1;
  LinearSolver linear_solver = LinearSolver::automatic;
  /// The stopping rule of other solvers, for comparisons: a solve also converges when an accepted
  /// step lowers the cost by at most this share. With 0 this rule is off.
  double relative_decrease = 0;
  /// True: the start is close to the minimum, so undamped steps come first.
  bool near_minimum = false;
  /// False: never computes second derivatives, for comparisons.
  bool second_derivatives = true;
  bool stop = true;  // false: iterates on at the minimum until max_iterations, for comparisons
  /// Receives each iteration, and the iterations between the linearisations for second derivatives.
  Progress progress;
};

struct SolveSummary {
  Outcome outcome = Outcome::not_converged;
  int iterations = 0;
  Cost cost;
  std::vector<std::pair<double, double>>
      history;               // chi2, damping: at the start and after each iteration
  int undefined_group = -1;  // of an undefined start: the first undefined group, or the costliest
};

/// Returns the summary. @throws Cancelled if the solve was cancelled
inline const SolveSummary& uncancelled(const SolveSummary& summary) {
  if (summary.outcome == Outcome::cancelled) throw_cancelled();
  return summary;
}

class LevenbergMarquardt {
 public:
  /// Analyses the structure and allocates all workspace. The problem must outlive the solver.
  LevenbergMarquardt(Problem& problem, SolverOptions options);
  ~LevenbergMarquardt();
  const char* linear_solver() const;

  /// Minimises from `state`, in place. Calls after the first allocate nothing (for dense systems
  /// and problems that allocate nothing), except when second derivatives are first computed without
  /// reserve(). The summary belongs to the solver and is valid until the next call. If cancelled,
  /// `state` is that of the last iteration.
  const SolveSummary& solve(VectorXd& state);

  /// Allocates what second derivatives need, for states of this size.
  void reserve(Eigen::Index state_size);

  /// Computes the undamped reduced system at `state`, for tests: matrix (n x n, both triangles) and
  /// gradient.
  void reduced(const VectorXd& state, MatrixXd& matrix, VectorXd& gradient);

 private:
  struct Workspace;
  std::unique_ptr<Workspace> w_;
};

}  // namespace kincal
