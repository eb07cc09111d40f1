// Data sets of ATOM (the calibration framework of the University of Aveiro): dataset.json.
#pragma once

#include <string>
#include <vector>

#include "../rig/rig_file.h"

namespace kincal {

/// Whether a file is such a data set: it has `collections` and `calibration_config`.
bool is_atom(const std::string& path);

/// Returns a line of samples.jsonl for every collection: its joints (of a robot with a flange: the
/// pose that its transforms make of base and flange), and a view for every pattern that a camera of
/// the rig detected, with the pixels and ids of its corners. Sensors and patterns have their names
/// in the rig; `notes` says what the rig does not have, and which labels are not of cameras.
/// @throws InputError
std::string atom_lines(const std::string& path, const Rig& rig, std::vector<std::string>& notes);

}  // namespace kincal
