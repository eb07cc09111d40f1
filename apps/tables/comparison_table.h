// Two calibrations compared.
#pragma once

#include <cstddef>
#include <string>

#include "../../io/results/comparison.h"

namespace kincal {

/// Shows the `most` parameters that differ most in sigmas, and the frames.
std::string comparison_table(const Comparison& comparison, size_t most);

}  // namespace kincal
