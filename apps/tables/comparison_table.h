// Two calibrations compared.
#pragma once

#include <cstddef>
#include <string>

#include "../../io/results/comparison.h"

namespace kincal {

/// The root mean square of error / sigma, of components that b estimated and of those that it kept.
std::string errors_text(const CalibratedFiles& b, const Comparison& comparison);

/// Shows the `most` parameters that differ most in sigmas, and the frames.
std::string comparison_table(const Comparison& comparison, size_t most);

}  // namespace kincal
