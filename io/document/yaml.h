// YAML text to a tree of nodes and back.
#pragma once

#include <string>

#include "node.h"

namespace kincal {

/// Parses a YAML text. @throws InputError with path:line:column on malformed text and on a
/// duplicate key of a mapping.
Node parse_yaml(const std::string& text, const std::string& path);

/// Writes the tree as block mappings (those of up to 3 simple values in one line) and flow
/// sequences of scalars (where they fit a line); strings are quoted where needed. The text reads
/// back as the same tree (odd plain texts become quoted). Comments are not kept.
std::string to_yaml(const Node& node);

/// Writes a text as a scalar, quoted where it must be.
std::string yaml_text(const std::string& text);

}  // namespace kincal
