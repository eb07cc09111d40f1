// The joints of a calibrated robot in the words of other programs. This header is internal to this
// folder.
#pragma once

#include <string>
#include <vector>

#include "../results/read_calibrated.h"

namespace kincal {

/// RobotNumbers are what a calibration says of the joints, one entry a joint.
struct RobotNumbers {
  const Rig& rig;
  std::vector<Pose> origins;  // parent_T_joint, without the offsets
  std::vector<Pose> folded;   // parent_T_joint with the offsets, as in robot.urdf
  std::vector<double> offsets, scales;
  std::vector<bool> estimated;  // origin or offset, or those of the joint that it follows; of a
                                // rig without result all
};
RobotNumbers robot_numbers(const CalibratedFiles& files);

/// Returns origins as xacro properties: JOINT_xyz and JOINT_rpy.
std::string xacro_properties(const RobotNumbers& robot);

/// Returns ros2_control's transmissions, whose offsets are those of the joints.
std::string ros2_control_text(const RobotNumbers& robot, std::vector<std::string>& notes);

/// Returns the text of LeRobot's calibration file `from` with other homing offsets. Motors are
/// joints by their names. `motors`: feetech or dynamixel. @throws InputError
std::string lerobot_text(const RobotNumbers& robot, const std::string& from,
                         const std::string& motors, std::vector<std::string>& notes);

}  // namespace kincal
