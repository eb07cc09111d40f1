// Words about what a calibration was given: numbers that cannot be meant, too few of them, what
// nothing sees.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "trial_warnings.h"

namespace kincal {

/// Warns of what rig and samples show by themselves (doctor/plausibility.h).
void warn_of_input(const Notices& input, Notices& out);
/// Warns where the unknowns without a prior are as many as what could determine them, or more.
void warn_of_few_data(const Solution& solution, Notices& out);
/// Warns of poses that are too few to tell their noise, and of postures that are repeated.
void warn_of_repetition(const Recording& recording, Notices& out);
/// Warns of bodies that no training sample shows.
void warn_of_unseen(const Solution& solution, Notices& out);
/// Warns of priors on numbers that no calibration estimated, because nothing depends on them.
void warn_of_unused_priors(const Solution& solution, Notices& out);
/// Warns of lengths and gears that came out as another number altogether.
void warn_of_rescaled(const Report& report, Notices& out);

/// Says what counts from the identity of a pose that the rig does not give (kind `identity`).
Notice identity_notice(const Solution& solution, const std::string& name);
/// The same of the first such pose, if there is one.
std::optional<Notice> counts_from_identity(const Solution& solution);
/// Returns the finding that may be why a calibration ended badly; null: none.
const Notice* first_mistake(const Report& report);
/// Returns whether a step has a loss that takes what is far away for an outlier altogether.
bool has_redescending_loss(const Solution& solution, const std::string& step);

}  // namespace kincal
