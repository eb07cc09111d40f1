// The robot of a result as it can be drawn: links, sensors and targets, before and after. It is not
// for users of the library: it brings the JSON library along and is not installed.
#pragma once

#include "../../models/report/report.h"
#include "../urdf/urdf.h"
#include "json_values.h"

namespace kincal {

/// Returns `scene` of result.json (docs/formats.md), with what the URDF draws of each link as
/// boxes. Parents come before their children.
Json scene_json(const Report& report, const Urdf& urdf);

}  // namespace kincal
