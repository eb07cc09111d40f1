// What follows for the rig's values from a fit with every mistake undone: start values that it left
// behind, noise of the readings.
#pragma once

#include <string>
#include <vector>

#include "../notices/notice.h"
#include "trial_fits.h"

namespace kincal {

/// Appends poses that the estimate left behind, but whose inverse is where the estimate ended.
void check_starts(const Recording& recording, const TrialContext& context, const TrialFit& now,
                  std::vector<Notice>& out);

/// Returns a sentence about how much noise of the joint readings would explain what is left; it is
/// empty if none does.
std::string joint_noise(const Recording& recording, const TrialContext& context,
                        const TrialFit& now);

}  // namespace kincal
