// The warnings that a user should read before using a result, made from a report that is otherwise
// complete.
#pragma once

#include <vector>

#include "report.h"

namespace kincal {

/// A learned width is unusual if it exceeds its initial value by this factor (two standard
/// deviations of its assumed distribution).
constexpr double kUnusualWidth = 9;

/// Returns whether a group's errors are far larger than usual, so that it may absorb a mistake.
/// (Usual compliances apply only to loads unlike those of rods of 1 kg.)
inline bool is_unusual(const AutomaticGroup& group) {
  return !group.held && group.widest > kUnusualWidth && !is_bending(group.name);
}

/// Both return one warning of each kind, the most important first. If a step did not converge they
/// return only that warning and its first likely cause, because everything else may follow from it.
Notices warnings(const Report& report);
Notices warnings(const Evaluation& evaluation);

}  // namespace kincal
