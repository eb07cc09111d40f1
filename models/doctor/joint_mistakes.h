// Mistakes about joint readings. The function appends its hypotheses.
#pragma once

#include <vector>

#include "survey.h"

namespace kincal {

/// Adds joints that turn the other way, that were logged as a constant, whose readings are degrees.
void add_joints(const Rig& rig, const std::vector<Sample>& samples, const Survey& survey,
                std::vector<Hypothesis>& out);

}  // namespace kincal
