// Local minima: runs the same steps from other starts, and tests whether they reach the same
// minimum.
//
// Levenberg-Marquardt finds a minimum near its start; the steps of estimation should make it the
// right one. This cannot be proved, but tested: parameters that a step estimates for the first time
// are moved at random before the step begins, and the results are compared. (Not all at once: if a
// step fixes parameters, other fixed values define another problem, not another minimum.)
//
// Distances. A component with a prior in its step is moved by N(0, the prior's sigma), any other by
// N(0, its usual error) of the table of scales (models/rig/scales.h).
// Poses move by an increment on the right, partly estimated ones by these components of xi. A
// start that cannot be evaluated (a point behind its camera) is tried again at half its distance,
// up to six times, because nobody would choose it.
//
// A loss whose scale comes from the data keeps the scales of the result's last step: otherwise
// every restart would minimise another cost.
//
// The same minimum: costs within 1e-6 of each other, relatively (or absolutely), and no estimated
// component different by more than 0.01 of its sigma; undetermined components are not compared. A
// restart whose last step did not converge, or without a start, counts as failed.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../calibration/calibration.h"

namespace kincal {

/// A Minimum is a result that some starts reached.
struct Minimum {
  double cost = 0, chi2 = 0;  // of the last step
  int count = 0;              // restarts that ended here
  /// The components that differ most from the result, up to 10: name, and minimum minus result in
  /// the result's sigmas.
  std::vector<std::pair<std::string, double>> differs;
};

struct Restarts {
  int count = 0, failed = 0;
  int not_converged = 0;        // of those that failed; the others have no start
  std::vector<Minimum> minima;  // the result's own first, the others by cost
};

/// Runs the steps of a solution `count` times, each from a different start; every call uses the
/// same starts. `options` must be those of the solution. Returns nullopt if cancelled.
std::optional<Restarts> restarts(const Solution& solution, const CalibrationOptions& options,
                                 int count);

/// True if the costs are within 1e-6 of each other, relatively or absolutely.
bool same_cost(double a, double b);

}  // namespace kincal
