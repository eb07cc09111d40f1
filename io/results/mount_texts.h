// Mounts in the syntax of other programs: a URDF joint, and command lines for ROS 1 and 2.
#pragma once

#include <string>
#include <vector>

#include "../../models/calibration/solution.h"

namespace kincal {

/// Returns a text quoted as one word of a shell command.
std::string shell_word(const std::string& text);

/// Returns a text escaped for XML, as attribute value or element content.
std::string xml_text(const std::string& text);
/// Returns the <joint> element of a fixed joint. `xyz` and `rpy` are those of its origin.
std::string fixed_joint_text(const std::string& joint, const std::string& parent,
                             const std::string& child, const std::string& xyz,
                             const std::string& rpy);

/// Returns a name made valid for a xacro property: letters, digits and _.
std::string xacro_name(const std::string& name);
/// Returns the properties NAME_xyz and NAME_rpy, one per line.
std::string xacro_origin(const std::string& name, const Pose& pose);

/// A MountText is the estimated pose of a sensor or mounted target that no joint of the URDF
/// contains. Both texts attach it to its link of the calibrated robot.
struct MountText {
  std::string name;  // sensor/NAME or target/NAME
  std::string urdf;  // <link> and <joint>, to be put into robot.urdf
  std::string ros2;  // a static_transform_publisher
};

std::vector<MountText> mount_texts(const Solution& solution);

/// Both return the command that publishes parent_T_child as a static transform.
std::string ros1_static_transform(const Pose& parent_T_child, const std::string& parent,
                                  const std::string& child);
std::string ros2_static_transform(const Pose& parent_T_child, const std::string& parent,
                                  const std::string& child);

/// Returns a new link name for the sensor or target `owner`, different from the robot's links and
/// from `taken`.
std::string new_link_name(const Tree& tree, const std::string& owner,
                          const std::vector<std::string>& taken);

/// Returns a new joint name: `name`, with a number appended if the robot already has it.
std::string new_joint_name(const Tree& tree, const std::string& name);

}  // namespace kincal
