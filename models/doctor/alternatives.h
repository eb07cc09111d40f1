// What the data say of a mistake undone against the data as they are: log odds.
//
// Both are fitted with everything free besides that robots usually have wrong, as far as they have
// it (rig/scales.h), so that what a robot is not drawn like counts for neither; their evidence is
// the log marginal likelihood with unknown noise (evidence/evidence.h). To it come
//     for each pose that the rig gives and the fit frees, moved by d (5 cm and 5 degrees each count
//     as 1):  -7/2 ln(1 + d^2), a Cauchy density in six dimensions: it is somewhere near, or wrong;
//     for each number that is left out (of a view 12 at most):  -ln 300, for what does not belong
//     may be anywhere within 300 sigmas;
//     where lengths are measured in another unit k, n numbers change their density by k^n.
// Beforehand one recording in a hundred has a mistake of a kind, and all of its kind are as likely.
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
