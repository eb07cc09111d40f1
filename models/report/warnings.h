// The words for everything that a user should know before using a result, made from a report that
// is otherwise complete.
#pragma once

#include <vector>

#include "report.h"

namespace kincal {

/// Widths that came out larger than those they began with by this factor, two spreads of what is
/// assumed of them, are unusual.
constexpr double kUnusualWidth = 9;

/// Both return one warning of a kind, what matters most first; where a step did not converge only
/// that and its first likely cause, of which everything else may come.
Notices warnings(const Report& report);
Notices warnings(const Evaluation& evaluation);

}  // namespace kincal
