// Local offsets as a file (local.yaml), and the posture at which they apply.
//
//     format: kincal-local/1
//     gain: true
//     offsets: {joint_2: {offset: 0.0021, sigma: 0.0001, unit: rad, determined: true}, ...}
// The whole list of keys is in docs/formats.md.
#pragma once

#include <string>

#include "../../models/trials/local.h"
#include "../rig/rig_file.h"

namespace kincal {

/// Parses a posture from user input: the id of a sample, 'joint=value,joint=value', or a YAML or
/// JSON file {joint: position, ...} (rad, m).
/// @throws InputError with the nearest names
LocalPosture read_local_posture(const std::string& text, const Rig& rig,
                                const std::vector<Sample>& samples);

/// A LocalSource describes the input of a local calibration.
struct LocalSource {
  std::string version, command, near;  // of the program, the command line, the posture as given
  std::string rig_hash, samples_hash, urdf_hash;  // SHA-256
};

/// Both return the file's keys: as JSON, and as YAML below a comment that warns of improper uses.
std::string local_json(const Rig& rig, const LocalPosture& posture, const LocalCalibration& local,
                       const LocalSource& source);
std::string local_yaml(const Rig& rig, const LocalPosture& posture, const LocalCalibration& local,
                       const LocalSource& source);

}  // namespace kincal
