// A length of the arm that is wrong alone, and that the size of a board hides.
//
// Lengths of an arm are taken to err alike (groups.h). One that is off by many times as much as the
// others, for somebody mistyped it, is then less likely than a board of another size: board and arm
// have one scale, and only the rest of that length, which is no scale, is left to the others. In
// the quadratic model of a fit (widths.h), with sizes put to what the rig has and the widths
// learned anew, the length sticks out; with a width of its own it explains the data as well. Let
// m be what all numbers move by. Beforehand the odds are ten to one against such a length, so that
// it is one with  P = 1 / (1 + 10 exp(-gain)),  and the second moment of the errors grows by P m
// m'.
#pragma once

#include <optional>

#include "groups.h"
#include "widths.h"

namespace kincal {

/// A LoneAlternative is such a length with what all unknowns move by if it is that, from the
/// posterior of the widths as they were learned, and how likely that is.
struct LoneAlternative {
  LoneLength length;
  VectorXd moved;          // m, by unknown
  double probability = 0;  // P
};

/// Returns the length that may be wrong in place of the sizes that came out as others by more than
/// three sigmas: with these as the rig has them it is off by 2.5 mm or more and by 2.5 times as
/// much as any length of another joint. nullopt: there is none, or no size did. `columns` are the
/// problem's unknowns.
std::optional<LoneAlternative> lone_length(const Recording& recording, const WidthProblem& problem,
                                           const std::vector<Component>& columns,
                                           const Widths& widths);

/// Returns by how much the log evidence grows if the largest length that the data tell by five
/// sigmas has a width of its own, the odds against it beforehand counted; nullopt: they tell none.
std::optional<double> lone_length_gain(const Recording& recording, const WidthProblem& problem,
                                       const std::vector<Component>& columns, const Widths& widths);

}  // namespace kincal
