// What result.json records of the robot, so that the changes of a result can be put into another
// copy of it. It is not for users of the library: it brings the JSON library along and is not
// installed.
#pragma once

#include <string>
#include <vector>

#include "../../models/calibration/solution.h"
#include "../document/document.h"
#include "json_values.h"

namespace kincal {

/// Writes a pose with its rotation as a matrix, so that it comes back to the last bit.
Json exact_pose(const Pose& p);
Pose read_exact_pose(const Field& field);

/// Returns type, axis and mimic of a joint as text, to see whether two URDFs agree.
std::string motion_text(const Tree& tree, const Joint& joint);

/// True if the poses are the same to the last bit.
bool equal(const Pose& a, const Pose& b);

}  // namespace kincal
