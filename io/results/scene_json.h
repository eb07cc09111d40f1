// The robot of a result as it can be drawn: links, sensors and targets, before and after. It is not
// for users of the library: it brings the JSON library along and is not installed.
#pragma once

#include "../../models/report/report.h"
#include "json_values.h"

namespace kincal {

/// Returns `scene` of result.json (docs/formats.md) of a robot of this name. Parents come before
/// their children.
Json scene_json(const Report& report, const std::string& robot);

}  // namespace kincal
