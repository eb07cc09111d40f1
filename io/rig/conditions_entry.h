// The conditions of a sample or posture (models/rig/samples.h) in its JSON line; in a rig.yaml the
// terms of joints' positions beside their models (models/rig/conditions.h), and a sensor's time
// offset.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../../kinematics/tree.h"
#include "../../models/joints/joint_models.h"
#include "../../models/rig/rig.h"
#include "../../models/rig/samples.h"
#include "../../models/sensors/sensor.h"
#include "../document/document.h"

namespace kincal {

/// Returns the keys of conditions, all optional.
const std::vector<std::string>& condition_keys();

/// Reads the conditions of a sample or posture, whose `joints` may have names that the robot lacks.
/// @throws InputError
Conditions read_conditions(const Field& sample, const Rig& rig);

/// Returns the conditions as they stand behind the joints: ", \"approach\": {...}", or "".
std::string conditions_text(const Rig& rig, const Conditions& conditions);

/// Reads a link's name. @throws InputError
int read_link(const Field& field, const Tree& tree);
/// Reads `payloads` of a rig. @throws InputError
std::vector<Payload> read_payloads(const Field& field, const Tree& tree);
/// Returns the index of a payload, whose name `where` has. @throws InputError
int find_payload(const Rig& rig, const std::string& name, const std::string& where);

/// Returns the keys of a joint's entry, those of all models among them.
std::vector<std::string> joint_keys(const JointModels& models);

/// Reads the terms that a joint's entry has in addition to its model. @throws InputError
void read_terms(const Field& entry, const Tree& tree, int joint, JointTerms& terms);

/// Fails where a joint that a sensor scans with has a ripple or a coupling, or is coupled to.
void check_terms_of_scanning(const Field& joints, const Rig& rig);

/// Reads `time_offset` and `line_time` of a sensor's entry. @throws InputError
void read_times(const Field& field, Sensor& sensor);

}  // namespace kincal
