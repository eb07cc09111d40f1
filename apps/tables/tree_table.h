// What `init` shows of a robot: its links and joints.
#pragma once

#include <string>

#include "../../kinematics/tree.h"

namespace kincal {

/// Shows every link below its parent, with the joint that it hangs on: type, limits, axis, mimic.
std::string tree_table(const Tree& tree);

}  // namespace kincal
