// Words about the numbers that came out: how far they are from where they were, how well they are
// known.
#pragma once

#include "trial_warnings.h"

namespace kincal {

/// Warns of poses far from where the rig has them. What the rig leaves open has no such place: its
/// movement from a start in closed form says nothing once it converged.
void warn_of_movements(const Solution& solution, Warnings& out);
/// Warns of numbers far from their priors, and of poses that are hardly known.
void warn_of_parameters(const Report& report, Warnings& out);

}  // namespace kincal
