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

/// Reads a rig and its robot. `urdf_path` is a robot in place of the rig's; joint offsets of the
/// rig are then taken as folded into it (0), scales and further numbers stay. `models` are the
/// joint models that the rig can name. @throws InputError
RigFile read_rig(const std::string& path, const std::string& urdf_path = "",
                 const JointModels& models = joint_models());

/// The joint of a robot that is known by the poses of its flange only.
constexpr const char* kFlangeJoint = "flange";
/// Makes the URDF of such a robot: two links and a floating joint between them.
/// @throws std::invalid_argument: equal or unusable names
Urdf flange_robot(const std::string& base, const std::string& flange, const std::string& path);

/// Reads the settings of all joints from `joints` of a rig; later entries win over earlier ones.
/// @throws InputError
std::vector<JointSettings> read_joint_settings(const Field& field, const Tree& tree,
                                               const JointModels& models);

}  // namespace kincal
