// Two cameras that came out in each other's place: somebody exchanged their names. Where their
// poses are free nothing else shows it, for the data are explained as well.
#pragma once

#include <vector>

#include "../calibration/solution.h"
#include "../doctor/finding.h"

namespace kincal {

/// Returns a finding (`swapped-cameras`) for each pair of cameras with given places of which each
/// was found where the other was given: within a quarter of the distance of these, and farther than
/// three quarters from its own.
std::vector<Finding> exchanged_cameras(const Solution& solution);

}  // namespace kincal
