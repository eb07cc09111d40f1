// rig.yaml written again with other values: what did not change keeps its text.
#pragma once

#include <string>
#include <vector>

#include "rig_file.h"

namespace kincal {

/// Replaces the steps of the rig, in its meaning and in its text.
void set_steps(RigFile& rig, const std::vector<Step>& steps);

/// RigValues are new values for a rig's text.
struct RigValues {
  std::vector<double> joint_offsets;               // by joint index: what is left after folding
  std::vector<double> joint_scales, joint_sigmas;
  std::vector<std::vector<double>> sensor_sigmas;  // by sensor index, as the model takes them
  std::vector<Pose> sensor_poses;                  // by sensor index
  std::vector<std::vector<std::vector<double>>> sensor_parameters;  // by sensor, block, component
  std::vector<Pose> target_poses;                  // by target index; of free ones ignored
  std::vector<double> target_squares;
  std::vector<Eigen::Matrix3Xd> target_points;     // not grids
};
RigValues values_of(const Rig& rig);

/// Returns the rig's text with `values` where they differ from the rig's own (poses: also where the rig has none and the value is not the
/// identity), and `robot` as the robot's file. Joints' numbers become entries of their own, after the globs.
std::string rig_text(const RigFile& rig, const RigValues& values, const std::string& robot);

}  // namespace kincal
