// Boards whose print looks the same from several sides, so that each picture is numbered by itself.
#pragma once

#include <map>
#include <vector>

#include "../../models/rig/targets.h"
#include "rig_file.h"

namespace kincal {

/// Returns the quarter turns after which the print of a board looks the same: 0 alone where the
/// print tells. `large_origin`: the circle at point 0 is bigger.
std::vector<int> turns_alike(const GridLayout& grid, bool large_origin);

/// Returns the targets of a rig that have more than one, with these.
std::map<int, std::vector<int>> alike_targets(const RigFile& rig);

/// Returns the views (sample, view) of cameras on such targets, mounted or held by a chain, whose
/// numbers nothing decides: with another numbering they agree with the joint readings as well.
std::vector<std::pair<int, int>> undecided_numbers(const RigFile& rig,
                                                   const std::vector<Sample>& samples);

}  // namespace kincal
