// A length of the arm that is wrong in the URDF, hidden by the size of a board: a size that came
// out as another and the lengths of an arm have one scale, so a length of the URDF that is wrong
// looks like a board that is (automatic/other_models.h).
#pragma once

#include <set>
#include <string>

#include "report.h"

namespace kincal {

/// Puts the finding `link-length` first where one length of the arm explains the data as well as
/// sizes that came out as others, in place of findings about these. `sizes` are those that moved
/// far.
void find_wrong_length(std::set<std::string> sizes, Report& report);

}  // namespace kincal
