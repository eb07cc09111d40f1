// Mistakes about joint readings and what they belong to. Functions that add append
// their hypotheses.
#pragma once

#include <optional>
#include <vector>

#include "observation_index.h"
#include "trial_fits.h"

namespace kincal {

/// Adds joints that turn the other way, that were logged as a constant, whose readings are degrees.
void add_joints(const Rig& rig, const std::vector<Sample>& samples,
                const ObservationIndex& observations, std::vector<Hypothesis>& out);

/// Adds readings that belong to the views of the sample before or after, of all sensors or of one.
void add_shifts(const Rig& rig, const std::vector<Sample>& samples,
                const ObservationIndex& observations, std::vector<Hypothesis>& out);

/// Adds readings whose rows are in another order than those of the views, reversed or sorted by
/// their digits, and joints whose readings are those of the sample before.
void add_orders_of_rows(const Rig& rig, const std::vector<Sample>& samples,
                        const ObservationIndex& observations, std::vector<Hypothesis>& out);

/// Finds by fits how much older or newer readings are than views, in samples of one steady motion,
/// where these follow each other in time (by their stamps, else evenly). Nothing: they do not, or
/// no lag lowers chi2.
std::optional<Hypothesis> time_lag(const Recording& recording, const TrialContext& context);

/// Finds by fits by which share of the way to the next sample's posture, or from the last one's,
/// the robot moved between readings and views. Nothing: no share lowers chi2.
std::optional<Hypothesis> unfinished_move(const Recording& recording, const TrialContext& context);

}  // namespace kincal
