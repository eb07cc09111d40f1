// Samples and views that a robust fit of the others leaves behind.
#pragma once

#include <optional>
#include <vector>

#include "trial_fits.h"

namespace kincal {

/// Fits with losses whose scale comes from the data and is lowered step by step, so that a minority
/// of wrong samples does not move the fit.
TrialFit robust_fit(const Recording& recording, const TrialContext& context);

/// Finds samples whose views do not belong to their joint readings; nothing where there are none,
/// or too many to distinguish them from the good ones.
std::optional<Hypothesis> bad_samples(const Recording& recording, const TrialContext& context,
                                      const TrialFit& robust);

/// Finds single points that lie far off in views that are good otherwise; nothing where there are
/// none, or too many.
std::optional<Hypothesis> outlier_points(const Recording& recording, const TrialContext& context,
                                         const TrialFit& robust);

/// Finds single views that fit far better after half a turn while everything shared stays: of the
/// numbers of a grid, of a camera's picture, or of both. At most one hypothesis of each.
std::vector<Hypothesis> turned_views(const Recording& recording, const TrialFit& robust);

}  // namespace kincal
