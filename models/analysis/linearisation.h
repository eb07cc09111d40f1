// A solution with its last step's problem linearised there: what analyses of noise, weak
// directions, leverage and frames start from, so that it is made and observed once.
#pragma once

#include <memory>

#include "../calibration/solution.h"

namespace kincal {

struct Linearisation {
  Solution solution;
  std::shared_ptr<LastProblem>
      at;  // the last step's problem at the solution, with its covariances renewed

  Estimation& problem() const { return *at->problem; }
  const VectorXd& state() const { return at->state; }
  const Observability& observability() const { return at->observability; }
  /// Returns the rows of a group after the elimination of its private unknowns: what observe()
  /// kept, else, in `scratch`, the same made again. The problem must be prepared at the state.
  const MatrixXd& reduced_rows(size_t group, MatrixXd& scratch) const;
  /// Gives back the memory of these rows.
  void drop_reduced_rows() const { std::vector<MatrixXd>().swap(at->kept_rows); }
};

/// Linearises at a solution, which must have values (Solution::usable(), or not_converged). It
/// takes what calibrate() left, else makes it again. @throws std::invalid_argument where estimates
/// are left to Calibration::last().
Linearisation linearise(const Solution& solution);

}  // namespace kincal
