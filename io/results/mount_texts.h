// Mounts in the words of other programs: a URDF's joint, and lines for ROS 1 and 2.
#pragma once

#include <string>
#include <vector>

#include "../../models/calibration/solution.h"

namespace kincal {

/// Returns a text as a word of a shell's command line.
std::string shell_word(const std::string& text);

/// Returns a text as it stands in XML, between quotes and between elements.
std::string xml_text(const std::string& text);
/// Returns the <joint> of a fixed joint; `xyz` and `rpy` are those of its origin.
std::string fixed_joint_text(const std::string& joint, const std::string& parent,
                             const std::string& child, const std::string& xyz,
                             const std::string& rpy);

/// Returns a name as that of a xacro property may be: letters, digits and _.
std::string xacro_name(const std::string& name);
/// Returns the properties NAME_xyz and NAME_rpy, one a line.
std::string xacro_origin(const std::string& name, const Pose& pose);

/// A MountText is the pose of a sensor or mounted target that was estimated, which no joint of the
/// URDF has. Both texts hang it on its link of the calibrated robot.
struct MountText {
  std::string name;  // sensor/NAME or target/NAME
  std::string urdf;  // <link> and <joint>, to be put into robot.urdf
  std::string ros2;  // a static_transform_publisher
};

std::vector<MountText> mount_texts(const Solution& solution);

/// Both return the command line that publishes parent_T_child as a static transform.
std::string ros1_static_transform(const Pose& parent_T_child, const std::string& parent,
                                  const std::string& child);
std::string ros2_static_transform(const Pose& parent_T_child, const std::string& parent,
                                  const std::string& child);

/// Returns the name of the link for a sensor or target called `owner`: none of the robot's links
/// nor of `taken` has it.
std::string new_link_name(const Tree& tree, const std::string& owner,
                          const std::vector<std::string>& taken);

/// Returns the name of a new joint: `name`, or with a number behind it where the robot has that.
std::string new_joint_name(const Tree& tree, const std::string& name);

}  // namespace kincal
