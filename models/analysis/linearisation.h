// A solution with its last step's problem linearised there: what analyses of noise, weak directions, leverage and frames start from, so
// that it is made and observed once.
#pragma once

#include <memory>

#include "../calibration/solution.h"

namespace kincal {

struct Linearisation {
  Solution solution;
  std::shared_ptr<LastProblem> at;  // the last step's problem at the solution, with its covariances renewed

  Estimation& problem() const { return *at->problem; }
  const VectorXd& state() const { return at->state; }
  const Observability& observability() const { return at->observability; }
  /// Rows of each group after the elimination of its private unknowns, as observe() gives them.
  const std::vector<MatrixXd>& left() const { return at->left; }
};

/// The solution must have values (Solution::usable(), or not_converged). Takes what calibrate() left, else makes it again.
Linearisation linearise(const Solution& solution);

}  // namespace kincal
