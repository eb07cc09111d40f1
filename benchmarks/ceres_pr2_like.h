// The PR2-like problem in Ceres: same data, same cost, same unknowns, same start as kincal's.
//
// usual:     what one writes first. Automatic derivatives, one residual block a corner; the corner
// walks the chain. strongest: analytic derivatives, one residual block a view. The chain is walked
// once a view; a corner costs its 2 x 6 (point: 3 x 6)
//            derivative times the view's constant kinematic matrix, written straight into Ceres'
//            Jacobian.
// compressed: strongest, and each view's rows replaced by a triangle of as many rows as the view
// has numbers (13 instead of 96), which
//            has the same J'J, J'r and r'r. That is kincal's own idea, done inside Ceres' cost
//            functions; it shows how much of the difference is this idea and how much is the rest.
// All eliminate the boards first (DENSE_SCHUR). Poses are 6-vectors xi with T = T0 exp(xi), so no
// manifold is needed and the priors are linear.
#pragma once

#include <memory>

#include "pr2_like.h"
#include "run.h"

namespace kincal::benchmarks {

enum class PeerForm { usual, strongest, compressed };

class CeresPr2Like {
 public:
  /// `problem` must outlive this.
  CeresPr2Like(const RobotProblem& problem, PeerForm form);
  ~CeresPr2Like();
  /// From the start, whatever was solved before.
  Run solve(int threads = 1);
  /// Gradient of the cost at a fixed place off the start, for comparing the forms: all blocks'
  /// entries in a fixed order.
  std::vector<double> gradient();

 private:
  struct Implementation;
  std::unique_ptr<Implementation> i_;
};

}  // namespace kincal::benchmarks
