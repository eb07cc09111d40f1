// A solution with its last step's problem linearised there: the common input of the analyses of
// noise, weak directions, leverage and frames, so that it is computed once.
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
  /// Returns the rows of a group after elimination of its private unknowns: those that observe()
  /// kept, else computed again in `scratch`. The problem must be prepared at the state.
  const MatrixXd& reduced_rows(size_t group, MatrixXd& scratch) const;
  /// Frees the memory of these rows.
  void drop_reduced_rows() const { std::vector<MatrixXd>().swap(at->kept_rows); }
};

/// Linearises at a solution, which must have values (Solution::usable(), or not_converged). It uses
/// the problem that calibrate() kept, or builds it again. @throws std::invalid_argument if
/// Calibration::last() has yet to compute the estimates.
Linearisation linearise(const Solution& solution);

}  // namespace kincal
