// Where sensors and mounted targets are, as descriptions of robots say it: static transforms, URDF
// and xacro.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../rig/rig_file.h"
#include "poses.h"

namespace kincal {

/// Returns a_T_b if nothing but fixed joints is between the links.
std::optional<Pose> fixed_pose(const Tree& tree, int a, int b);

/// A Mount is a frame that hangs on a link of the robot.
struct Mount {
  std::string of;             // sensor or target
  std::string parent, child;  // links
  std::string joint;          // the name of the one between them
  Pose parent_T_child;
  bool in_robot = false;  // the robot has this joint with this origin already
  bool new_link = true;   // the child is none of the robot's links
};

/// Returns the mounts of the sensors of these names, of no names of all sensors and mounted
/// targets; `notes` say which are left away. A thing that a joint of the robot places has that
/// joint; with `frames` the sensor's or target's own frame below the joint's parent. @throws
/// InputError if there is none
std::vector<Mount> mounts_of(const Rig& rig, const std::vector<std::string>& sensors, bool frames,
                             std::vector<std::string>& notes);

/// Returns the mount of a sensor's driver, whose own frame `child` is another than the sensor's.
/// `known` is child_T_sensor, "x y z roll pitch yaw" or "x y z qx qy qz qw", or the link of the
/// robot that is the sensor's frame for the driver; empty: the sensor's link.
/// @throws InputError
Mount driver_mount(const Rig& rig, const Sensor& sensor, const std::string& child,
                   const std::string& known);

/// The formats of mounts; the text is that of all but `poses`.
const std::vector<std::string>& mount_formats();
std::string mounts_text(const std::vector<Mount>& mounts, const std::string& format);

/// Returns the mounts as a table (CSV) of poses in one of pose_formats(): id, in (the link) and its
/// columns.
std::string poses_text(const std::vector<Mount>& mounts, const PoseFormat& format);

}  // namespace kincal
