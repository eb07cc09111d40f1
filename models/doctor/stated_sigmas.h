// Sigmas of the rig that are wrong by a factor: what size the noise has that the data show.
#pragma once

#include <optional>

#include "../notices/notice.h"
#include "trial_fits.h"

namespace kincal {

/// Finds sigmas of sensors and joints that are wrong by a factor of 5 or more, at the fit of
/// everything that the steps free. Residuals that are too large count as noise only if they are
/// spread over all samples, if neighbouring points do not err alike, and if errors of the robot
/// and the sensors of the usual sizes, which are freed for that, do not explain them.
std::optional<Notice> wrong_sigmas(const Recording& recording, const TrialContext& context,
                                   const TrialFit& now);

}  // namespace kincal
