// Samples of a robot that is known by the poses of its flange, as files of kincal's: from tables of
// poses, and from the samples of hand-eye programs.
#pragma once

#include <string>
#include <vector>

#include "poses.h"

namespace kincal {

/// Returns a JSON line for every pose, as the reading of the joint `flange`. With the names of a
/// sensor and a target these are samples whose images `kincal detect` fills in; without ("") they
/// are readings for its --joints.
std::string flange_lines(const std::vector<FlangePose>& poses, const std::string& sensor,
                         const std::string& target);

struct HandEyeFiles {
  std::string rig_yaml, samples_jsonl;
  int count = 0;  // of samples
};

/// Whether a file has such samples: MoveIt's hand-eye plugin (a list of effector_wrt_world and
/// object_wrt_sensor), or easy_handeye's (.samples, or its service's answer).
bool is_hand_eye(const std::string& path);

/// Reads the samples of a hand-eye program. `in_hand`: the camera is on the flange, the board
/// stands still; else the other way round. @throws InputError
HandEyeFiles read_hand_eye(const std::string& path, bool in_hand);

}  // namespace kincal
