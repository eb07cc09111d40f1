// Sigmas of the rig that are wrong by a factor: what size the noise has that the data show.
#pragma once

#include <optional>
#include <string>

#include "../evidence/evidence.h"
#include "../notices/notice.h"
#include "trial_fits.h"

namespace kincal {

/// Finds sigmas of sensors and joints that are wrong by a factor of 5 or more: `found` is the
/// evidence of the data as they are, with errors of the robot and the sensors of the usual sizes
/// free. Of a sensor's views only how their points lie to each other counts, if they have several:
/// what else moves a view as a whole is not its noise. Residuals that are too large count as noise
/// only if they are spread over all samples and neighbouring points do not err alike. `now`: the
/// fit of everything that the steps free.
std::optional<Notice> wrong_sigmas(const Recording& recording, const TrialContext& context,
                                   const TrialFit& now, const ModelEvidence& found);

/// Returns a sentence about the noise of joint readings that would explain what the sensors' does
/// not; empty if none does.
/// `least`: so many times the stated noise is more than that.
std::string joint_noise(const Recording& recording, const ModelEvidence& found, double least = 2);

}  // namespace kincal
