// Words about noise that is not as stated: levels that were estimated, what nobody stated, and
// joints whose noise looks like a gear of another ratio.
#pragma once

#include "trial_warnings.h"

namespace kincal {

constexpr double kNoisy = 3;  // times as noisy as stated: a joint that something else is wrong with

/// Returns whether the automatic path multiplied all sigmas by one factor below a half, of several
/// kinds of noise: if only one of them was stated too large, the result's sigmas are too small.
bool all_sigmas_lowered(const Report& report);
/// What to write into a rig for the noise of its sensors, as the data show it.
std::string sensors_as_seen(const Report& report);
/// Warns where sigmas were estimated from the data (the automatic path, --estimate-noise).
void warn_of_noise(const Report& report, Warnings& out);

}  // namespace kincal
