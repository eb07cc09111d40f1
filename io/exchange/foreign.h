// Files of other programs as trees: YAML as ROS, Kalibr and OpenCV write it, and OpenCV's XML.
#pragma once

#include <string>

#include "../document/node.h"

namespace kincal {

/// Parses a file of another program; XML is made into the tree that OpenCV's YAML of the same
/// content gives. Of several YAML documents (messages that ROS prints) the first counts.
/// @throws InputError
Node read_foreign(const std::string& path);

/// Likewise, of any YAML, JSON or XML of OpenCV: whatever kind of file it looks like.
Node read_any_tree(const std::string& path);

}  // namespace kincal
