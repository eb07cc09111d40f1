// A batch of calibrations in one table.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "../../io/results/summary_file.h"

namespace kincal {

/// Shows how many sets have each status, chi2/dof and rms over the sets, and the sets that are not
/// converged, with reasons. `ignored` counts the folders that are no sets.
std::string batch_table(const std::vector<SetSummary>& sets, size_t ignored);

}  // namespace kincal
