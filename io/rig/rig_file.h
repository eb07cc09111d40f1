// rig.yaml and samples.jsonl: strict reading, with the place of everything wrong, and writing.
#pragma once

#include <string>
#include <vector>

#include "../../models/rig/rig.h"
#include "../../models/rig/samples.h"
#include "../document/document.h"
#include "../urdf/urdf.h"

namespace kincal {

/// A rig as read: its meaning and its text.
struct RigFile {
  std::string path;
  std::string text;
  Node node;          // the parsed text, to write it again with other values
  Rig rig;
  Urdf urdf;
};

/// Reads a rig and its robot. `urdf_path`: a robot in place of the rig's; joint offsets of the rig are then taken as folded
/// into it (0), scales stay. @throws InputError
RigFile read_rig(const std::string& path, const std::string& urdf_path = "");

/// Gives the rig other steps, in its meaning and in its text.
void set_steps(RigFile& rig, const std::vector<Step>& steps);

/// @throws InputError "path:line: views[2].ids: ..."; every joint that a used chain needs must be there.
std::vector<Sample> read_samples(const std::string& path, const Rig& rig);

/// One JSON line a sample, as read_samples takes them (numbers in the shortest form that reads back the same).
std::string samples_text(const Rig& rig, const std::vector<Sample>& samples);

/// New values for a rig's text.
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

/// The rig's text with `values` where they differ from the rig's own (poses: also where the rig has none and the value is
/// not the identity), and `robot` as the robot's file. Joints' numbers become entries of their own, after the globs.
std::string rig_text(const RigFile& rig, const RigValues& values, const std::string& robot);

}  // namespace kincal
