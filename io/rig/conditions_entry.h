// The conditions of a sample or posture (models/rig/samples.h) in its JSON line, and a sensor's
// time offset in a rig.yaml.
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "../../kinematics/tree.h"
#include "../../models/rig/samples.h"
#include "../../models/sensors/sensor.h"
#include "../document/document.h"

namespace kincal {

/// Returns the keys of conditions, all optional.
const std::vector<std::string>& condition_keys();

/// Reads the conditions of a sample or posture, whose `joints` may have names that the robot lacks.
/// @throws InputError
Conditions read_conditions(const Field& sample, const Tree& tree);

/// Returns the conditions as they stand behind the joints: ", \"approach\": {...}", or "".
std::string conditions_text(const Tree& tree, const Conditions& conditions);

/// Reads `time_offset` of a sensor's entry; none: it has no such key. @throws InputError
std::optional<double> read_time_offset(const Field& sensor, const SensorModel& model);

}  // namespace kincal
