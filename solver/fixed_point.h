// Anderson's acceleration of a fixed point x = g(x), whose plain iteration x <- g(x) contracts
// slowly.
//
// With f = g(x) - x and the differences of the last steps as columns of F and G, the next x is
//     g(x) - G w,   w = argmin |f - F w|,
// where these steps, were g linear, leave the least f. (Anderson, "Iterative procedures for
// nonlinear integral equations", J. ACM 12, 1965; Walker and Ni, SIAM J. Numer. Anal. 49, 2011.)
#pragma once

#include <Eigen/Core>
#include <vector>

namespace kincal {

class FixedPoint {
 public:
  /// `memory`: how many differences are used. `largest_step`: of any element of x, in a step.
  FixedPoint(int memory, double largest_step) : memory_(memory), largest_step_(largest_step) {}

  /// Returns where to go on from x; all x have one size. Where f has grown, what was learned before
  /// no longer holds: it is forgotten, and the next x is g(x). It allocates.
  Eigen::VectorXd next(const Eigen::VectorXd& x, const Eigen::VectorXd& g);

 private:
  size_t memory_;
  double largest_step_;
  Eigen::VectorXd last_f_, last_g_;     // of the step before; empty: there is none
  std::vector<Eigen::VectorXd> f_, g_;  // differences, the oldest first
};

}  // namespace kincal
