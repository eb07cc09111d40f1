// Words about the numbers that came out: how far they are from where they were, how well they are
// known.
#pragma once

#include <optional>

#include "trial_warnings.h"

namespace kincal {

/// Warns of poses far from where the rig has them. What the rig leaves open has no such place: its
/// movement from a start in closed form says nothing once it converged.
void warn_of_movements(const Solution& solution, Notices& out);
/// Returns whether a pose is known to no better than 0.3 m or 30 degrees.
bool has_open_mount(const Report& report);
/// Returns whether the pose component that is known worst would be known if a target's size were.
bool hangs_on_a_size(const Report& report);
/// Returns the warning `sigma` of parameters known to no better than 1 cm or 1 degree, with why and
/// what to do about the worst; a fault if that is a pose known to no better than 3 cm or 3 degrees.
/// (What the zero of the first or last joint decides does not count: gauge_freedoms.h.)
std::optional<Notice> loose_parameters(const Report& report);
/// Warns of numbers far from their priors, and of poses that are hardly known.
/// What no posture tells and the automatic path fixed.
void warn_of_gauges(const Report& report, Notices& out);
void warn_of_parameters(const Report& report, Notices& out);

}  // namespace kincal
