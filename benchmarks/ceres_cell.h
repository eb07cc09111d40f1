// The cell in Ceres: same data, same cost, same unknowns, same start as kincal's. Analytic
// derivatives, one residual block a view; all numbers of an arm and its camera are one parameter
// block (no view touches only some of them), as are those of a fixed camera.
#pragma once

#include <memory>

#include "pr2_like.h"
#include "run.h"

namespace kincal::benchmarks {

class CeresCell {
 public:
  /// `problem`: cell(). It must outlive this.
  explicit CeresCell(const RobotProblem& problem);
  ~CeresCell();
  /// From the start, whatever was solved before. Boards are eliminated first: SPARSE_SCHUR (Ceres'
  /// choice of CHOLMOD) or DENSE_SCHUR.
  Run solve(bool sparse, int threads = 1);

 private:
  struct Implementation;
  std::unique_ptr<Implementation> i_;
};

}  // namespace kincal::benchmarks
