// One robot over time: which of its numbers changed, steadily or at once.
//
// Model. Result t, at time T_t, says R_t x_t = z_t + e, e ~ N(0, 1) (Evidence, family.h). If
// nothing changed all x_t are one unknown x. What could have happened instead: one number c has
// moved, x_t = x + b f_t e_c, with
//     a line,    f_t = T_t - their mean by time, b the drift per unit of time, or
//     a change,  f_t = 1 from some result on, 0 before, b the step.
// The weighted fit of b beside all of x, x eliminated, is, with N_t = R_t'R_t, N = sum N_t,
//     q = sum f_t^2 (N_t)_cc - g'N^-1 g,   g = sum f_t N_t e_c,
//     b = 1/q sum f_t e_c'(R_t'z_t - N_t x),   sigma = 1 / sqrt(q).
// x is whatever it is, however badly known: only what differs between results counts, and numbers
// that the data cannot tell apart still show that one of them has moved. (Each then shows it.)
//
// What explains it. The line or change with the most sigmas is taken (of numbers that explain as
// well the first, family.h); its p is that of the largest of all that were tried (Bonferroni). With
// its b free beside x the others are tried again, until nothing is left with p below the level: a
// list of causes, the surest first.
//
// Numbers that are new in every result, as the place of a board that is put up anew, are eliminated
// from its equations first.
#pragma once

#include <string>

#include "family.h"

namespace kincal {

/// Returns the evidence after removing these components; it then has no information on them.
Evidence without_numbers(const Evidence& evidence, const std::vector<int>& numbers);

/// A Slope is b with its sigma.
struct Slope {
  double value = 0, sigma = 0;  // sigma 0: cannot be told
  double in_sigmas() const { return sigma > 0 ? value / sigma : 0; }
};

/// A NumberDrift is a number's best line and best change, if it alone moved.
struct NumberDrift {
  int number = -1;
  Slope line, change;
  int from = 0;  // the result from which on it is changed
};

/// A Cause is a line or change that explains what differs.
struct Cause {
  int number = -1;
  int from = 0;  // of a change; 0: it is a line
  Slope slope;   // beside the causes before
  double p = 1;
};

struct Drift {
  std::vector<NumberDrift> numbers;  // those of which anything can be told
  std::vector<Cause> causes;         // those with p below the level
  double p = 1;                      // of the first, whether it is below or not
};

/// Looks for changes between results in the order of their times. A component whose b would be less
/// certain than its scale (for a line: over the whole time) is left out.
Drift find_drift(const std::vector<Evidence>& results, const std::vector<double>& times,
                 const VectorXd& scale, double level);

}  // namespace kincal
