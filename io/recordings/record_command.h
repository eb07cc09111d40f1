// The command lines that record what a rig needs. It needs none of the libraries that read
// recordings.
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

}  // namespace kincal
