// A calibration target from Kalibr's YAML.
#pragma once

#include <string>
#include <vector>

#include "rig_entry.h"

namespace kincal {

/// Whether a file of another program is such a target.
bool is_kalibr_target(const std::string& path);

/// Returns the keys of rig.yaml that describe a target of Kalibr's: checkerboard, circlegrid,
/// aprilgrid. All keys that targets have and this one has not are taken away; the mount stays.
/// @throws InputError with file, line and field
RigKeys read_kalibr_target(const std::string& path, std::vector<std::string>& notes);

}  // namespace kincal
