// The kinematics of a robot of Universal Robots as its ROS packages have them: origins of six
// joints (ur_description, `kinematics:`; ur_calibration reads them from the robot).
#pragma once

#include <string>
#include <vector>

#include "../../kinematics/tree.h"

namespace kincal {

struct UrKinematics {
  std::vector<Pose> origins;  // of the six joints, from the base on
  std::string hash;           // of the robot that has them; "": not said
};

/// Returns the six joints of a robot, with a prefix before their usual names; "": the only one that
/// there is. @throws InputError
std::vector<int> ur_joints(const Tree& tree, const std::string& prefix);

UrKinematics read_ur_kinematics(const std::string& path);
std::string ur_kinematics_text(const UrKinematics& kinematics);

}  // namespace kincal
