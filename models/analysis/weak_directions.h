// What the data determine weakly or not at all, in words: weak directions, what trades off in them,
// why, and what would help.
//
// C is the covariance of the shared unknowns from the data alone: the last step's without its
// priors. Where C does not exist (solver/observability.h: null directions) nothing but a prior
// decides. Of the rest, a component is weak if its sigma is above its yardstick
// (models/rig/scales.h), or its prior's sigma where that is less. Which numbers would have to be
// held is found by a pivoted Cholesky factorisation of C in yardsticks: the worst component i goes
// first and is taken as held, C <- C - C_i C_i' / C_ii, until no component is weak. Each of these
// pivots K gives a direction: how the other unknowns follow it while the other pivots stand still,
// the columns of C_K (C_KK)^-1; its sigma is the pivot's. (Eigenvectors would mix directions of
// like sigma.)
//
// Why is looked for in the model (reasons.h). Where that finds no reason, or free targets, and with
// exact readings sigma were less than half, the joints' noise hides it.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "linearisation.h"

namespace kincal {

struct WeakDirection {
  Direction parameters;  // the first one has coefficient 1: to hold it is enough
  std::string unit;      // of the first one
  double sigma =
      0;  // of the first one from the data alone, the others following it; NaN: not determined
  double sigma_with_priors = 0;  // the same in the result
  std::string reason;  // nothing_depends, on_axis, same_axis, same_shift, same_points, size, lens,
                       // one_orientation, free_targets, hand_eye, joint_noise, unknown
  std::string why, cure;
  std::vector<std::string> joints;  // that would have to move (more)
};

struct Correlation {
  std::string a, b;
  double correlation;
};

struct PriorDecides {
  std::string name, unit;
  double prior, sigma;
};

struct Explanation {
  std::vector<WeakDirection> weak;  // those of `unobservable` first, in its order
  std::vector<PriorDecides>
      prior_decides;  // sigma above 0.9 of the prior's: the data add next to nothing
  std::vector<Correlation>
      correlations;  // from the data alone, above 0.99 in size, the largest first

  /// Returns a few lines for each weak direction: what is weak, why, and what would help.
  std::string text() const;
};

/// Explains the directions that the data of the last step determine weakly at its solution.
Explanation explain(const Linearisation& at);

}  // namespace kincal
