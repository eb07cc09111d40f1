// Estimated mounts in the words of other programs: a URDF's joint, and a line for ROS 2.
#pragma once

#include <string>
#include <vector>

#include "../../models/calibration/solution.h"

namespace kincal {

/// A MountText is the pose of a sensor or mounted target that was estimated, which no joint of the
/// URDF has. Both texts hang it on its link of the calibrated robot.
struct MountText {
  std::string name;  // sensor/NAME or target/NAME
  std::string urdf;  // <link> and <joint>, to be put into robot.urdf
  std::string ros2;  // a static_transform_publisher
};

std::vector<MountText> mount_texts(const Solution& solution);

}  // namespace kincal
