// Numbers of a URDF written in place: only those that changed are replaced, so comments, blanks and
// unknown elements survive byte for byte.
#pragma once

#include <map>
#include <string>

#include "urdf.h"

namespace kincal {

/// UrdfChanges are what to write: new origins (parent_T_joint) by joint index, and new mechanical
/// reductions by joint name.
struct UrdfChanges {
  std::map<int, Pose> origins;
  std::map<std::string, double> reductions;
};

/// Returns the text with these numbers in place of the old. An origin's xyz is rewritten only if
/// the translation differs from the one in the text, rpy only if the rotation does; each in up to
/// 17 significant digits. With no change it is the input itself.
/// @throws std::invalid_argument for a joint without a transmission as in reductions.h, and for
/// numbers that are not finite.
std::string edit_urdf(const Urdf& urdf, const UrdfChanges& changes);

}  // namespace kincal
