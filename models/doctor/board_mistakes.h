// Mistakes about how boards are laid out and their points numbered. Each function appends its
// hypotheses.
#pragma once

#include <vector>

#include "observation_index.h"

namespace kincal {

/// Adds rows and columns exchanged, points numbered from another corner or mirrored, corners of
/// tags in another order.
void add_boards(const Rig& rig, const ObservationIndex& observations, std::vector<Hypothesis>& out);
/// Adds boards whose rows have one point more or less than the rig says: squares counted in place
/// of inner corners, another board.
void add_widths(const Rig& rig, const std::vector<Sample>& samples,
                const ObservationIndex& observations, std::vector<Hypothesis>& out);
/// Adds ids of a board's points that are one too large or too small, where no view has the first id
/// or none the last.
void add_counts_from_one(const Rig& rig, const std::vector<Sample>& samples,
                         const ObservationIndex& observations, std::vector<Hypothesis>& out);

}  // namespace kincal
