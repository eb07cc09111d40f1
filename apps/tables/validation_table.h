// The errors of a fit on data that it did not see.
#pragma once

#include <string>

#include "../../models/report/report.h"

namespace kincal {

/// Shows held-out errors with intervals, folds, frames, tolerances; it is empty if there are none
/// of these.
std::string validation_table(const Report& report);

}  // namespace kincal
