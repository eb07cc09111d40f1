// Boards that look the same from several sides, numbered as the joint readings say
// (models/fitting/numbering.h).
#pragma once

#include <map>
#include <nlohmann/json.hpp>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "../rig/rig_file.h"
#include "image_target.h"

namespace kincal {

/// Returns the quarter turns of a board after which its picture is numbered the same way: 0 alone
/// where the picture tells.
std::vector<int> open_turns(const ImageTarget& target);

/// Numbers the `filled` views (sample, view) of such boards anew, all others stay. Returns what
/// there is to say. Samples that are not complete yet, or have no joint readings, stay as they are.
std::vector<std::string> renumber(const RigFile& rig,
                                  const std::map<std::string, ImageTarget>& targets,
                                  const std::set<std::pair<int, int>>& filled,
                                  std::vector<nlohmann::ordered_json>& samples);

}  // namespace kincal
