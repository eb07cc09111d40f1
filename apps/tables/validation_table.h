// The errors of a fit on data that it did not see.
#pragma once

#include <string>

#include "../../models/report/report.h"

namespace kincal {

/// Shows held-out errors with intervals, folds, frames, tolerances; it is empty if there are none
/// of these.
std::string validation_table(const Report& report);

/// Returns a line for each column of residuals that is not final; empty: all are.
std::string unfinished_text(const std::vector<Unfinished>& all, bool held_out_only = false);

}  // namespace kincal
