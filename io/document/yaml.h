// YAML text to a tree of nodes and back.
#pragma once

#include <string>

#include "node.h"

namespace kincal {

/// @throws InputError with path:line:column on malformed text and on a key that stands twice in a mapping.
Node parse_yaml(const std::string& text, const std::string& path);

/// The tree is written as block mappings (those of up to 3 simple values in one line) and flow sequences of scalars (where they fit
/// a line); strings are quoted where needed. The text reads back as the same tree (odd plain texts become quoted). Comments are not kept.
std::string to_yaml(const Node& node);

/// A text is written as a scalar, quoted where it must be.
std::string yaml_text(const std::string& text);

}  // namespace kincal
