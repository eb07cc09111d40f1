// Samples of a robot that is known by the poses of its flange, as files of kincal's: from tables of
// poses, from pairs of poses of the flange and of what a camera or tracker saw, and from the
// samples of hand-eye programs.
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

struct PosePair {
  std::string id;  // "": by its place
  Pose base_T_flange, sensor_T_target;
};

/// Whether a file has such pairs: MoveIt's hand-eye plugin (a list of effector_wrt_world and
/// object_wrt_sensor), or easy_handeye's (.samples, or its service's answer).
bool is_hand_eye(const std::string& path);

/// Reads the samples of a hand-eye program. `in_hand`: the camera is on the flange, the board
/// stands still; else the other way round. @throws InputError
std::vector<PosePair> read_hand_eye(const std::string& path, bool in_hand);

/// How poses stand in files: the name of a format ("": as the file says) and of a unit ("": the
/// file's or the format's).
struct PoseWords {
  std::string format, unit;
};

/// Returns the format that is given, or that the kind of file has. `what` begins the message where
/// neither is: "--pose-format". @throws InputError
const PoseFormat& format_of_file(const Table& table, const PoseWords& words,
                                 const std::string& what);

/// Reads poses of the flange, of which `files` has all in one (a table, an array, lists in YAML or
/// JSON) or one each; a number at the end of such a file's name is the pose's id. `what` begins the
/// message where the format is not known: "--pose-format". @throws InputError
std::vector<FlangePose> read_poses(const std::vector<std::string>& files, const PoseWords& words,
                                   const std::string& what);

/// Pairs poses of the flange with measured ones: by their ids where both have them, else by their
/// order; `note` says how. @throws InputError: counts that differ, an id that only one side has
std::vector<PosePair> pair_poses(const std::vector<FlangePose>& flange,
                                 const std::vector<FlangePose>& measured, std::string& note);

/// Whether each row of a file has two poses, or the file has two lists of as many poses.
bool has_pairs(const std::vector<Table>& tables);

/// Reads such pairs: first the flange's, then the measured one. @throws InputError
std::vector<PosePair> pairs_of(const std::vector<Table>& tables, const PoseWords& flange,
                               const PoseWords& measured, std::string& note);

struct HandEyeFiles {
  std::string rig_yaml, samples_jsonl;
};

/// Returns a rig and samples of a camera (any sensor of poses) and a board. `from`: the file that
/// the pairs are from. @throws InputError where a position is too large
HandEyeFiles hand_eye_files(const std::string& from, const std::vector<PosePair>& pairs,
                            bool in_hand);

}  // namespace kincal
