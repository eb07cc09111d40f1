// Directions that the data determine poorly or not at all, in words: the components that compensate
// each other, the reason, and the remedy.
//
// C is the covariance of the shared unknowns from the data alone: the last step's without its
// priors. Where C does not exist (solver/observability.h: null directions) nothing but a prior
// determines them. Of the rest, a component is weak if its sigma is above its yardstick
// (models/rig/scales.h), or its prior's sigma where that is less. The components that would have to
// be fixed are found by a pivoted Cholesky factorisation of C in yardsticks: the worst component i
// goes first and counts as fixed, C <- C - C_i C_i' / C_ii, until no component is weak. Each of
// these pivots K gives a direction: how the other unknowns follow it while the other pivots are
// fixed, the columns of C_K (C_KK)^-1; its sigma is the pivot's. (Eigenvectors would mix directions
// of similar sigma.)
//
// The reason is sought in the model (reasons.h). If there is none, or only free targets, and exact
// readings would halve the sigma, the reason is the joints' noise.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "linearisation.h"

namespace kincal {

struct WeakDirection {
  Direction parameters;  // the first one has coefficient 1: fixing it is sufficient
  std::string unit;      // of the first one
  double sigma =
      0;  // of the first one from the data alone, the others following it; NaN: not determined
  double sigma_with_priors = 0;  // the sigma in the result
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
      prior_decides;  // sigma above 0.9 of the prior's: the data add almost nothing
  std::vector<Correlation>
      correlations;  // from the data alone, above 0.99 in size, the largest first

  /// Returns a few lines for each weak direction: the components, the reason, and the remedy.
  std::string text() const;
};

/// Explains the weak directions of the last step at its solution.
Explanation explain(const Linearisation& at);

}  // namespace kincal
