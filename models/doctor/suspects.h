// Samples and views that a robust fit of the others leaves behind.
#pragma once

#include <optional>
#include <vector>

#include "trial_fits.h"

namespace kincal {

/// A fit with losses whose scale comes from the data, lowered step by step, so that a minority of wrong samples has no say.
TrialFit robust_fit(const Recording& recording, const TrialContext& context);

/// Samples whose views do not belong to their joint readings; nothing where there are none, or too many to be told from the good ones.
std::optional<Hypothesis> bad_samples(const Recording& recording, const TrialContext& context, const TrialFit& robust);

/// Half a turn of single views of a grid: those that it makes fit far better while everything shared stays. One hypothesis or none.
std::vector<Hypothesis> turned_views(const Recording& recording, const TrialFit& robust);

}  // namespace kincal
