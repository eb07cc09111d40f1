// A length of the arm that is wrong in the URDF, hidden by the size of a board.
//
// A size that came out as another and the lengths of an arm have one scale: a length of the URDF
// that is wrong looks like a board that is. Where the sizes moved so far that somebody may have
// been mistaken, or the automatic path saw a length that may be wrong alone (lone_lengths.h), the
// data are calibrated once more with the sizes held. Then that one length sticks out.
#pragma once

#include <set>
#include <string>

#include "../automatic/automatic.h"
#include "report.h"

namespace kincal {

/// Puts the finding `link-length` first where one length of the arm explains the data as well as
/// sizes that came out as others, in place of findings about these. `sizes` are those that moved
/// far; `given` is the rig as the user has it. @throws Cancelled
void look_for_a_wrong_length(const Rig& given, std::set<std::string> sizes,
                             AutomaticOptions options, Report& report);

}  // namespace kincal
