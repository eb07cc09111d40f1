// Log odds of a mistake, undone, against the data as they are.
//
// Both are fitted with all usual errors of a robot free, with priors of their usual size
// (rig/scales.h), so that errors of the robot's own geometry favour neither. Their evidence is the
// log marginal likelihood with unknown noise (evidence/evidence.h), plus
//     for each pose that the rig gives and the fit frees, moved by d (5 cm and 5 degrees each count
//     as 1):  -7/2 ln(1 + d^2), a Cauchy density in six dimensions;
//     for each effective residual of a view that is left out:  -ln 300: an outlier may be anywhere
//     within 300 sigmas;
//     if the mistake is a unit (lengths k times as large), n ln k for n effective residuals.
// Prior odds: each kind of mistake is in one recording of a hundred, shared by all of its kind.
// Nothing is decided by these odds yet; their rate of false alarms has not been measured.
#pragma once

#include <vector>

#include "trial_fits.h"

namespace kincal {

/// Returns the log evidence of a trial, or of the data as they are (`h` null).
double log_evidence(const Recording& recording, const TrialContext& context, const Stage& stage,
                    const TrialFit& fit, const Hypothesis* h);

/// Adds what a trial says against the data as they are, of which `as_is` is the evidence, to what
/// was tried. `alike`: mistakes of its kind.
void tell_alternative(const TrialContext& context, const Hypothesis& h, const Trial& trial,
                      double as_is, size_t alike);

}  // namespace kincal
