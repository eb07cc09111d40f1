// Data of which the part before some sample and the part from it on contradict each other:
// something changed between that no single mistake says. A joint was homed anew, a camera, tracker
// or target was bumped, a lens was set otherwise, or the data are of two robots.
//
// Samples in the order of logging are split, each part is fitted by itself with the same unknowns,
// and the split is the one that leaves least. As a sample on the wrong side costs the more the more
// of them there are, it is found from a few splits by halving. It is a finding by its odds
// (alternatives.h), the parameters that the steps free being unknown in both parts and the rest as
// the rig has it: against one fit of all, with the noise that is found within the parts, because
// one fit would take the difference of the parts for noise; and against parts as large that are
// spread over all samples, because two fits explain more than one anyway where something is wrong
// that is not of one moment.
#pragma once

#include <functional>
#include <optional>

#include "../notices/notice.h"
#include "trial_fits.h"

namespace kincal {

struct Changed {
  Notice finding;
  double log_evidence;  // of both parts, with the prior
};

/// Returns where a row of n is best cut in two parts of at least `fewest`, found by halving from
/// the best of the quarters and `also`; 0: nowhere.
int best_cut(int n, int fewest, int also, const std::function<double(int)>& cost);

/// Returns the finding where there is such a split; nullopt: there is none, or too few samples.
/// `now`: the fit of all. @throws Cancelled
std::optional<Changed> two_parts(const Recording& recording, const TrialContext& context,
                                 const TrialFit& now);

}  // namespace kincal
