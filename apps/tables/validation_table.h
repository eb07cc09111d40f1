// What data that the fit did not see say of it.
#pragma once

#include <string>

#include "../../models/report/report.h"

namespace kincal {

/// Held-out errors with intervals, folds, frames, tolerances; empty if there is nothing of these.
std::string validation_table(const Report& report);

}  // namespace kincal
