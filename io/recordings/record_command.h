// The command lines that record what a rig needs, and which topics the rig says. It needs none of
// the libraries that read recordings.
#pragma once

#include <string>
#include <vector>

#include "../rig/rig_file.h"

namespace kincal {

/// A RecordCommand has one line for ROS 1 and one for ROS 2, and what is assumed in them.
struct RecordCommand {
  std::string ros1, ros2;
  std::vector<std::string> notes;
};

/// Makes them from the `topic` of sensors and joints; what the rig does not say is called as ROS
/// usually does.
RecordCommand record_command(const RigFile& rig);

/// Returns the topic that the rig gives a sensor; "": none.
std::string given_topic(const RigFile& rig, const std::string& sensor);
/// Returns the topics that the rig gives the joints.
std::vector<std::string> given_joint_topics(const RigFile& rig);
/// Returns what stands before the robot's names of joints in recordings, as the rig says.
std::string given_joint_prefix(const RigFile& rig);

}  // namespace kincal
