// Data of which the part before some sample and the part from it on contradict each other:
// something changed between that no single mistake says. A joint was homed anew, a camera, tracker
// or target was bumped, a lens was set otherwise, or the data are of two robots.
//
// Samples in the order of logging are split, each part is fitted by itself with the same unknowns,
// and the split is the one that leaves least. As a sample on the wrong side costs the more the more
// of them there are, it is found from a few splits by halving. Two fits leave less than one anyway:
// parts as large that are spread over all samples must leave three times as much.
#pragma once

#include <optional>

#include "../notices/notice.h"
#include "trial_fits.h"

namespace kincal {

/// Returns the finding (`changed`) where both parts are explained by themselves and all together
/// are not (`now`, of all that was not undone). nullopt: no such split, or too few samples. @throws
/// Cancelled
std::optional<Notice> two_parts(const Recording& recording, const TrialContext& context,
                                const TrialFit& now);

}  // namespace kincal
