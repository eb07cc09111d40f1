// One sensor or target of a rig.yaml gets other values, in the text: comments and everything else
// stay as they are.
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "../rig/rig_file.h"

namespace kincal {

/// Keys with their new values as YAML in one line; an empty text takes the key away.
using RigKeys = std::vector<std::pair<std::string, std::string>>;

/// Writes keys below one another, for people to copy.
std::string keys_text(const RigKeys& keys);

struct EditedRig {
  std::string text;
  bool comments_kept = true;  // false: the text could not be changed in place and is written anew
};

/// Returns the rig's text with `keys` in `section` (sensors, targets), entry `name`, and `robot` as
/// its robot. What is written is read again and compared.
EditedRig edited_rig(const RigFile& rig, const std::string& section, const std::string& name,
                     const RigKeys& keys, const std::string& robot);

}  // namespace kincal
