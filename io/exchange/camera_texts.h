// Cameras from texts that are neither YAML nor JSON, as the tree that YAML of the same content
// gives: ost.txt (camera_calibration of ROS, the old format), the list of rs-enumerate-devices.
#pragma once

#include <optional>
#include <string>

#include "../document/node.h"

namespace kincal {

/// Returns the tree of such a text; nullopt: it is none. A file of several cameras is a mapping of
/// their names. @throws InputError: it is one of those that kincal does not read, and what to do
std::optional<Node> camera_text(const std::string& text, const std::string& path);

}  // namespace kincal
