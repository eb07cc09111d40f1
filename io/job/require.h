// Tolerances as they are given: `require`.
#pragma once

#include <string>
#include <vector>

#include "../../models/report/requirements.h"
#include "../../models/rig/recording.h"
#include "words.h"

namespace kincal {

/// Parses "sensor/tracker<0.2mm", "sensor/left_*<1mrad", "frame/tool0<0.5mm" or "chi2/dof<1.5" in
/// the terms of a rig; a glob of sensors gives one requirement for each. @throws InputError:
/// malformed, unknown sensor, frame or unit, a unit that does not fit. `option` is what it was
/// given by.
std::vector<Requirement> parse_requirement(const std::string& text, const Recording& recording,
                                           Words words, const std::string& option = "require");

}  // namespace kincal
