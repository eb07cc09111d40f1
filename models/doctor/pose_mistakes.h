// Mistakes about poses that were logged: readings of floating joints, such as of a robot known by
// its flange, and what sensors measure, such as motion capture.
#pragma once

#include <vector>

#include "observation_index.h"

namespace kincal {

/// Adds poses that are the wrong way round, in millimetres, or in another convention of rotations
/// than they were read in.
void add_pose_readings(const Rig& rig, const std::vector<Sample>& samples,
                       const ObservationIndex& observations, std::vector<Hypothesis>& out);

/// Adds the hypotheses that measured poses have quaternions in another order, or another
/// convention.
void add_pose_views(const Rig& rig, const ObservationIndex& observations,
                    std::vector<Hypothesis>& out);

}  // namespace kincal
