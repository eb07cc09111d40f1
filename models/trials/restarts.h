// Local minima: the same steps from other places, and whether they end in the same minimum.
//
// Levenberg-Marquardt finds a minimum near its start; steps of estimation are there to make it the
// right one. That cannot be proved, but it can be tried: whatever a step frees that no step before
// it did is moved at random before the step begins, and the ends are compared. (Not everything at
// once: in a step that holds something, other held values mean another problem, not another minimum
// of the same.)
//
// How far. A component with a prior in its step is moved by N(0, the prior's sigma), any other by
// N(0, its usual error) of the table of scales (models/rig/scales.h).
// Poses move by an increment on the right, partly freed ones by their freed components of xi. A
// start that cannot be evaluated (a point behind its camera) is tried again at half its distance,
// up to six times: such a start would not be chosen.
//
// A loss whose scale comes from the data keeps the scales of the result's last step: else every
// restart would minimise another cost.
//
// The same minimum: costs within 1e-6 of each other, relatively (or absolutely), and no estimated
// number apart by more than 0.01 of its sigma; what the data do not determine is not compared. An
// end whose last step did not converge, or without a start, counts as failed.
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../calibration/calibration.h"

namespace kincal {

/// A Minimum is where some starts ended.
struct Minimum {
  double cost = 0, chi2 = 0;  // of the last step
  int count = 0;              // restarts that ended here
  /// These components differ most from the result, up to 10: name, and minimum minus result in the
  /// result's sigmas.
  std::vector<std::pair<std::string, double>> differs;
};

struct Restarts {
  int count = 0, failed = 0;
  int not_converged = 0;        // of those that failed; the others have no start
  std::vector<Minimum> minima;  // the result's own first, the others by cost
};

/// Runs the steps that led to a solution `count` times from other starts, the same starts every
/// time. The options are those of the solution. nullopt: cancelled.
std::optional<Restarts> restarts(const Solution& solution, const CalibrationOptions& options,
                                 int count);

/// True if the costs are within 1e-6 of each other, relatively or absolutely.
bool same_cost(double a, double b);

}  // namespace kincal
