// The words for everything that a user should know before using a result, made from a report that
// is otherwise complete.
#pragma once

#include <vector>

#include "report.h"

namespace kincal {

/// Both return warnings in this order: what has no effect, starting values, samples that cannot be
/// evaluated, steps and directions, chi2, joint errors, parameters, samples that stick out, noise,
/// other minima.
std::vector<Warning> warnings(const Report& report);
std::vector<Warning> warnings(const Evaluation& evaluation);

}  // namespace kincal
