// The words for everything that a user should know before using a result, made from a report that
// is otherwise complete.
#pragma once

#include <vector>

#include "report.h"

namespace kincal {

/// A width that is larger than its initial value by this factor (two spreads of the assumed width)
/// is unusual.
constexpr double kUnusualWidth = 9;

/// Returns whether a group came out far worse than usual, so that it may absorb a mistake. (Usual
/// compliances are known only for loads unlike those of rods of 1 kg.)
inline bool is_unusual(const AutomaticGroup& group) {
  return !group.held && group.factor > kUnusualWidth && !is_bending(group.name);
}

/// Both return one warning of each kind, the most important first. If a step did not converge they
/// return only that warning and its first likely cause, because everything else may follow from it.
Notices warnings(const Report& report);
Notices warnings(const Evaluation& evaluation);

}  // namespace kincal
