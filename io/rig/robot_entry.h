// The robot of a rig: its key `robot`.
#pragma once

#include <string>

#include "../document/document.h"
#include "../urdf/urdf.h"

namespace kincal {

/// The joint of a robot that reports only its flange poses.
constexpr const char* kFlangeJoint = "flange";
/// Makes the URDF of this robot: two links connected by a floating joint.
/// @throws std::invalid_argument: equal or invalid names
Urdf flange_robot(const std::string& base, const std::string& flange, const std::string& path);

/// Reads the robot that a rig names, relative to the rig's file, or makes the robot of a flange.
/// @throws InputError
Urdf read_robot_entry(const Field& robot, const std::string& rig_path);

}  // namespace kincal
