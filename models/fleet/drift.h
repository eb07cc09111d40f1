// One robot over time: which of its components changed, steadily or at once.
//
// Model. Result t, at time T_t, says R_t x_t = z_t + e, e ~ N(0, 1) (Evidence, family.h). If
// nothing changed all x_t are one unknown x. The alternative is that one component c
// has moved, x_t = x + b f_t e_c, with
//     a line,    f_t = T_t - their mean by time, b the drift per unit of time, or
//     a change,  f_t = 1 from some result on, 0 before, b the step.
// The weighted fit of b beside all of x, x eliminated, is, with N_t = R_t'R_t, N = sum N_t,
//     q = sum f_t^2 (N_t)_cc - g'N^-1 g,   g = sum f_t N_t e_c,
//     b = 1/q sum f_t e_c'(R_t'z_t - N_t x),   sigma = 1 / sqrt(q).
// x is arbitrary and may be undetermined: only differences between results count. If the data
// cannot distinguish some components, each of them shows the change of one.
//
// Causes. The line or change with the most sigmas is chosen (among components that explain equally
// well the first, family.h); its p is that of the largest of all that were tried (Bonferroni). With
// its b estimated beside x, the others are tried again, until none has p below the level: a list of
// causes, most certain first.
//
// Components that are new in every result, such as the pose of a board that is mounted again, are
// first eliminated from its equations.
#pragma once

#include <string>

#include "family.h"

namespace kincal {

/// Returns the evidence without information on these components (they are eliminated).
Evidence without_numbers(const Evidence& evidence, const std::vector<int>& numbers);

/// A Slope is b with its sigma.
struct Slope {
  double value = 0, sigma = 0;  // sigma 0: not determined
  double in_sigmas() const { return sigma > 0 ? value / sigma : 0; }
};

/// A NumberDrift is the best line and the best change of a component, if it alone moved.
struct NumberDrift {
  int number = -1;
  Slope line, change;
  int from = 0;  // first changed result
};

/// A Cause is a line or change that explains the differences.
struct Cause {
  int number = -1;
  int from = 0;  // of a change; 0: it is a line
  Slope slope;   // estimated beside the earlier causes
  double p = 1;
};

struct Drift {
  std::vector<NumberDrift> numbers;  // components that the data determine
  std::vector<Cause> causes;         // those with p below the level
  double p = 1;                      // of the first, whether below the level or not
};

/// Tests for changes between results in the order of their times. A component is left out if the
/// sigma of its b (for a line: over the whole time) would exceed its scale.
Drift find_drift(const std::vector<Evidence>& results, const std::vector<double>& times,
                 const VectorXd& scale, double level);

}  // namespace kincal
