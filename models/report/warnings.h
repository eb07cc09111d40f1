// The words for everything that a user should know before using a result, made from a report that
// is otherwise complete.
#pragma once

#include <vector>

#include "report.h"

namespace kincal {

/// Widths that came out larger than those they began with by this factor, two spreads of what is
/// assumed of them, are unusual.
constexpr double kUnusualWidth = 9;

/// Returns whether a group came out so much worse than usual that it may take up a mistake. (What
/// is usual of compliances nobody knows where the loads are those of rods of 1 kg.)
inline bool is_unusual(const AutomaticGroup& group) {
  return !group.held && group.factor > kUnusualWidth && !is_bending(group.name);
}

/// Both return one warning of a kind, what matters most first; where a step did not converge only
/// that and its first likely cause, of which everything else may come.
Notices warnings(const Report& report);
Notices warnings(const Evaluation& evaluation);

}  // namespace kincal
