// URDF in and out. The text of the input is the truth: it is read strictly, with lines in the messages, and written by
// replacing only the numbers that changed, so comments, blanks and unknown elements survive byte for byte.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "../../kinematics/tree.h"

namespace kincal {

/// A <transmission>'s mechanical reduction for a joint: only where one number can be meant (not with several joints or several
/// numbers in a transmission, nor with unexpanded ${...}).
struct Transmission {
  std::string name, joint;
  double reduction = 1;
};

/// An origin as it stands in the file: xyz and rpy in the file's own digits ("0 0 0" where absent), for changes.yaml.
struct OriginText {
  std::string xyz, rpy;
};

/// A URDF as read.
struct Urdf {
  std::string path;                    // where it came from, for messages
  std::string text;                    // the file, byte for byte
  Tree tree;
  std::vector<OriginText> origins;     // by joint
  std::vector<Transmission> transmissions;
  std::vector<std::string> warnings;   // e.g. an undefined root link that was accepted
};

/// @throws InputError (document.h) "path:line: element: what is wrong, what is valid".
Urdf read_urdf(const std::string& path);
Urdf parse_urdf(const std::string& text, const std::string& path);

/// What to write: new origins (parent_T_joint) by joint index, and new mechanical reductions by joint name.
struct UrdfChanges {
  std::map<int, Pose> origins;
  std::map<std::string, double> reductions;
};

/// The text with these numbers in place of the old. An origin's xyz is rewritten only if the translation differs from
/// the one in the text, rpy only if the rotation does; each in up to 17 significant digits. With no change: the input itself.
/// @throws std::invalid_argument for a joint without a transmission as above, and for numbers that are not finite.
std::string edit_urdf(const Urdf& urdf, const UrdfChanges& changes);

inline const OriginText& origin_text(const Urdf& urdf, int joint) { return urdf.origins.at(joint); }

/// Folds joint offsets into origins: origin' = origin * motion(axis, offset). A mimic follower of a joint whose offset is d gets
/// motion(axis, multiplier * d) in its own origin (through chains of mimics the product of multipliers).
/// `origins`, `offsets`: one entry a joint.
std::vector<Pose> fold_offsets(const Tree& tree, const std::vector<Pose>& origins, const std::vector<double>& offsets);

/// Proves that `text` means the model: for `postures` random positions (fixed seed, all joints, within limits or +-pi) the pose of
/// every link by the written file (position = reading) equals that of (tree, origins, offsets: position = reading + offset) to
/// 1e-9 m and rad. The file is read with urdfdom, as ROS does; where urdfdom refuses the input already, with read_urdf.
/// @throws std::runtime_error naming the first link that differs and by how much.
void prove_urdf(const std::string& text, const Urdf& input, const std::vector<Pose>& origins, const std::vector<double>& offsets,
                int postures = 20);

}  // namespace kincal
