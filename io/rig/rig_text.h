// Writes rig.yaml with other values; unchanged entries keep their text.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rig_file.h"

namespace kincal {

/// Replaces nominal values in the rig's data and text.
void set_nominal(RigFile& rig, const std::vector<NominalValue>& values);

/// Appends priors, each with one sigma, to the rig's data and text.
void add_priors(RigFile& rig, const std::vector<PriorSetting>& priors);

/// Replaces the lens of a camera by that of `found`, in the rig's data and text. `model` is the
/// lens's name in rig.yaml, written only if the type of lens changes.
void set_lens(RigFile& rig, int camera, const std::string& model, const Sensor& found);

/// RigValues are new values for a rig's text.
struct RigValues {
  std::vector<double> joint_offsets;  // by joint index: the rest after folding
  std::vector<double> joint_scales, joint_sigmas;
  std::vector<std::shared_ptr<const JointModel>> joint_models;
  std::vector<std::vector<double>>
      joint_further;  // components of the models beyond offset and scale
  std::vector<JointTerms> joint_terms;
  std::vector<std::vector<double>> sensor_sigmas;  // by sensor index, in the model's order
  std::vector<std::optional<double>> sensor_time_offsets, sensor_line_times;  // none: no parameter
  std::vector<std::optional<Pose>> sensor_poses;  // by sensor index; none: unknown
  std::vector<std::vector<std::vector<double>>> sensor_parameters;  // by sensor, block, component
  std::vector<std::optional<Pose>> target_poses;  // by target index; of free ones ignored
  std::vector<double> target_squares;
  std::vector<Eigen::Vector2d> target_warps;
  std::vector<std::optional<Eigen::Vector2d>> target_prints;
  std::vector<Eigen::Matrix3Xd> target_points;  // not grids
  std::optional<Elasticity> elasticity;         // if set, the entry is written again
};
RigValues values_of(const Rig& rig);

/// Returns the rig's text with `values` where they differ from the rig's (also poses that the rig
/// lacks), and with `robot` as the robot's file. Joint parameters become entries of their own after
/// the globs.
/// @throws InputError if a joint's model differs from that in the text and has no name in rig.yaml.
std::string rig_text(const RigFile& rig, const RigValues& values, const std::string& robot);

}  // namespace kincal
