// Reads rig.yaml strictly; errors name their place. rig_text.h writes it,
// samples_file.h reads and writes samples.
#pragma once

#include <string>
#include <vector>

#include "../../models/joints/joint_models.h"
#include "../../models/rig/rig.h"
#include "../../models/rig/samples.h"
#include "../document/document.h"
#include "../urdf/urdf.h"
#include "robot_entry.h"

namespace kincal {

/// A RigFile is a rig as read: the data and its text.
struct RigFile {
  std::string path;
  std::string text;
  Node node;  // the parsed text, to write it again with other values
  Rig rig;
  Urdf urdf;                 // its tree as written: floating joints are opened in the rig's only
  bool flange_only = false;  // `robot: {base, flange}`: there is no URDF, this is made up
  JointModels joint_models;  // those that the rig can name
  std::string serial, time;  // of the robot and the recording, unchanged; for the record
};

/// Reads a rig and its robot. If `urdf_path` is given, it replaces the rig's robot; the rig's joint
/// offsets are then assumed to be folded into it and become 0, other joint parameters (scales
/// included) are kept. `models` are the joint models that the rig can name. @throws InputError
RigFile read_rig(const std::string& path, const std::string& urdf_path = "",
                 const JointModels& models = joint_models());
/// Parses a rig. `path` is for messages and locates the files that the rig names. If `robot` is
/// null, the robot file that the rig names is read. `robot` is ignored if the rig's robot reports
/// only flange poses. @throws InputError, also if `robot` has no text and is needed
RigFile parse_rig(std::string text, const std::string& path, const Urdf* robot = nullptr,
                  const JointModels& models = joint_models());

/// Reads the settings of all joints from `joints` of a rig; later entries override earlier ones.
/// @throws InputError
std::vector<JointSettings> read_joint_settings(const Field& field, const Tree& tree,
                                               const JointModels& models);

}  // namespace kincal
