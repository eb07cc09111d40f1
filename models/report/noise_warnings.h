// Words about noise that is not as stated: levels that were estimated, what nobody stated, and
// joints whose noise looks like a gear of another ratio.
#pragma once

#include "trial_warnings.h"

namespace kincal {

constexpr double kNoisy = 3;  // times as noisy as stated: a joint that something else is wrong with

/// Warns where sigmas were estimated from the data (the automatic path, --estimate-noise).
void warn_of_noise(const Report& report, Warnings& out);

}  // namespace kincal
