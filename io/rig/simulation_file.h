// Files of a simulation: postures (JSON lines) in, the truth (JSON) in and out.
//
// A posture:  {"id": "left_000", "joints": {"l_elbow_flex_joint": -1.53}, "views": [{"sensor":
// "left_arm", "target": "small_board"}],
//              "targets": {"large_board": {"xyz": [2.5, 0, 0], "rpy": [0, 0, 0]}}}
// Joints are true readings, targets poses base_T_target of free targets that no chain holds; both
// last keys may be left away.
//
// A truth:    {"about": ..., "parameters": {NAME: VALUE}, "samples": ...}
// NAME is a parameter or one of its components; VALUE a number, a list of the parameter's numbers,
// or {"initial": ..., "true": number or list}. Poses are increments from the rig's value, anything
// else is the value itself; what is not there is as in the rig.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "../../models/simulation/simulation.h"
#include "../document/document.h"

namespace kincal {

/// Reads postures. @throws InputError "path:line: views[2].sensor: ..."; every view must be
/// possible: joints there, free targets held or placed.
std::vector<Posture> read_postures(const std::string& path, const Rig& rig);
/// The same from the text of a file; `path` is for messages.
std::vector<Posture> parse_postures(const std::string& text, const std::string& path,
                                    const Rig& rig);

/// Reads values in the table's layout. "samples" is not looked at. @throws InputError
VectorXd read_truth(const std::string& path, const ParameterTable& table);
VectorXd parse_truth(const std::string& text, const std::string& path, const ParameterTable& table);

/// Reads how the robot of a truth file stood in each sample, by its id: true readings, and poses of
/// free targets. @throws InputError
std::map<std::string, Posture> read_true_postures(const std::string& path, const Rig& rig);

/// Writes a truth file: all components that differ from the rig, and per sample the true readings
/// and poses of free targets.
std::string truth_text(const Rig& rig, const ParameterTable& table, const Simulation& simulation);

}  // namespace kincal
