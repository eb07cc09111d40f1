// Mistakes about readings that are poses: of floating joints, such as a robot known by its flange.
#pragma once

#include <vector>

#include "survey.h"

namespace kincal {

/// Adds poses that are the wrong way round, in millimetres, or in another convention of rotations
/// than they were read in.
void add_pose_readings(const Rig& rig, const std::vector<Sample>& samples, const Survey& survey,
                       std::vector<Hypothesis>& out);

}  // namespace kincal
