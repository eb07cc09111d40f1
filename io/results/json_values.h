// Values as the JSON files of a result have them. It is not for users of the library: it brings the
// JSON library along and is not installed.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "../../kinematics/transform.h"
#include "../document/node.h"

namespace kincal {

using Json = nlohmann::ordered_json;

/// The text of a JSON file. Command lines, paths and errors may be in any encoding: bytes that are
/// not UTF-8 are replaced, so that a result is written whatever its folder is called.
std::string json_text(const Json& json);

/// The tree that parse_json() makes of that text, but for the places.
Node node_of(const Json& json);

/// A number that is not finite becomes null.
Json number(double v);
Json numbers(const std::vector<double>& v);
Json vector3(const Vector3d& v);
/// A pose becomes {xyz, quat}.
Json pose(const Pose& p);

}  // namespace kincal
