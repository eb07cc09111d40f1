// rig.yaml written again with other values: what did not change keeps its text.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rig_file.h"

namespace kincal {

/// Replaces the nominal values of the rig, in its meaning and in its text.
void set_nominal(RigFile& rig, const std::vector<NominalValue>& values);

/// Adds priors of one number each to the rig, in its meaning and in its text, behind its own.
void add_priors(RigFile& rig, const std::vector<PriorSetting>& priors);

/// Replaces the lens of a camera, in the rig's meaning and in its text, by that of `found`; `model`
/// is the rig's word for it.
void set_lens(RigFile& rig, int camera, const std::string& model, const Sensor& found);

/// RigValues are new values for a rig's text.
struct RigValues {
  std::vector<double> joint_offsets;  // by joint index: what is left after folding
  std::vector<double> joint_scales, joint_sigmas;
  std::vector<std::shared_ptr<const JointModel>> joint_models;
  std::vector<std::vector<double>> joint_further;  // numbers of the models beyond offset and scale
  std::vector<std::vector<double>> sensor_sigmas;  // by sensor index, as the model takes them
  std::vector<std::optional<Pose>> sensor_poses;   // by sensor index; none: not known
  std::vector<std::vector<std::vector<double>>> sensor_parameters;  // by sensor, block, component
  std::vector<std::optional<Pose>> target_poses;  // by target index; of free ones ignored
  std::vector<double> target_squares;
  std::vector<Eigen::Vector2d> target_warps;
  std::vector<Eigen::Matrix3Xd> target_points;  // not grids
  std::optional<Elasticity> elasticity;         // with it the entry is written anew
};
RigValues values_of(const Rig& rig);

/// Returns the rig's text with `values` where they differ from the rig's own (poses: also where the
/// rig has none), and `robot` as the robot's file. Joints' numbers become entries of their own,
/// after the globs.
/// @throws InputError if a joint has another model than in the text, and one that a rig cannot
/// name.
std::string rig_text(const RigFile& rig, const RigValues& values, const std::string& robot);

}  // namespace kincal
