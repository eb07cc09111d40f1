// A length of the arm that is wrong in the URDF, hidden by the size of a board: both have one
// scale, so that a wrong length looks like a board of another size (automatic/other_models.h).
#pragma once

#include <set>
#include <string>

#include "report.h"

namespace kincal {

/// Puts the finding `link-length` first, in place of findings about sizes, where one length of the
/// arm explains the data as well as changed sizes. `sizes` are those whose estimates are far from
/// the rig's values.
void find_wrong_length(std::set<std::string> sizes, Report& report);

}  // namespace kincal
