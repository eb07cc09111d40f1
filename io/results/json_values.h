// Values as the JSON files of a result have them. It is not for users of the library: it brings the
// JSON library along and is not installed.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "../../kinematics/transform.h"

namespace kincal {

using Json = nlohmann::ordered_json;

/// A number that is not finite becomes null.
Json number(double v);
Json numbers(const std::vector<double>& v);
Json vector3(const Vector3d& v);
/// A pose becomes {xyz, quat}.
Json pose(const Pose& p);

}  // namespace kincal
