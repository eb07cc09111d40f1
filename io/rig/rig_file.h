// rig.yaml: strict reading, with the place of everything wrong. rig_text.h writes it again,
// samples_file.h has the samples.
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

/// A RigFile is a rig as read: its meaning and its text.
struct RigFile {
  std::string path;
  std::string text;
  Node node;  // the parsed text, to write it again with other values
  Rig rig;
  Urdf urdf;                 // its tree as written: floating joints are opened in the rig's only
  bool flange_only = false;  // `robot: {base, flange}`: there is no URDF, this is made up
  JointModels joint_models;  // that the rig can name
  std::string serial, time;  // of the robot and the recording, as they stand; for the record
};

/// Reads a rig and its robot. `urdf_path` replaces the rig's robot; joint offsets of the rig are
/// then assumed to be folded into it (0), scales and other joint parameters are kept. `models` are
/// the joint models that the rig can name. @throws InputError
RigFile read_rig(const std::string& path, const std::string& urdf_path = "",
                 const JointModels& models = joint_models());
/// Reads a rig from a text. `path` is for messages and for files that the rig names, which are
/// beside it. `robot` is the robot; if null, the file that the rig names is read. It is not used if
/// the rig's robot reports only its flange poses. A robot without text is an error if it is needed.
/// @throws InputError
RigFile parse_rig(std::string text, const std::string& path, const Urdf* robot = nullptr,
                  const JointModels& models = joint_models());

/// Reads the settings of all joints from `joints` of a rig; later entries win over earlier ones.
/// @throws InputError
std::vector<JointSettings> read_joint_settings(const Field& field, const Tree& tree,
                                               const JointModels& models);

}  // namespace kincal
