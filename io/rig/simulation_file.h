// Files of a simulation: postures (JSON lines) in, the truth (JSON) in and out.
//
// A posture:  {"id": "left_000", "joints": {"l_elbow_flex_joint": -1.53}, "views": [{"sensor":
// "left_arm", "target": "small_board"}],
//              "targets": {"large_board": {"xyz": [2.5, 0, 0], "rpy": [0, 0, 0]}}}
// Joints are true readings, targets poses base_T_target of free targets that no chain holds; both
// last keys are optional, and so is "from": readings that the robot comes from, as "joints".
//
// A truth:    {"about": ..., "parameters": {NAME: VALUE}, "values": {NAME: VALUE}, "samples": ...}
// NAME is a parameter or one of its components; VALUE a number, a list of the parameter's
// components, or {"initial": ..., "true": number or list}. Poses are increments from the rig's
// value, anything else is the value itself; absent parameters have the rig's value. In `values`
// poses are link_T_frame, independent of a rig: {"xyz": ..., "quat" or "rpy": ...}.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "../../models/simulation/simulation.h"
#include "../document/document.h"

namespace kincal {

/// Reads postures. Every view must be possible: its joints have readings, and free targets are held
/// by a chain or have a pose. @throws InputError "path:line: views[2].sensor: ..."
std::vector<Posture> read_postures(const std::string& path, const Rig& rig);
/// Parses postures from a text; `path` is for messages.
std::vector<Posture> parse_postures(const std::string& text, const std::string& path,
                                    const Rig& rig);

/// Both return values in the table's layout and ignore "samples". Of `absolute` parameters, by
/// index in the table, "values" count before "parameters"; of others they do not. @throws
/// InputError
VectorXd read_truth(const std::string& path, const ParameterTable& table);
VectorXd parse_truth(const std::string& text, const std::string& path, const ParameterTable& table,
                     const std::vector<int>& absolute = {});

/// Reads the true posture of each sample by its id: true readings and poses of free targets.
/// @throws InputError
std::map<std::string, Posture> read_true_postures(const std::string& path, const Rig& rig);

/// Returns a truth file: all components that differ from the rig, the values of all parameters of
/// sensors and targets, and for each sample the true readings and poses of free targets.
std::string truth_text(const Rig& rig, const ParameterTable& table, const Simulation& simulation);

}  // namespace kincal
