// YAML text to a tree of nodes and back.
#pragma once

#include <string>

#include "node.h"

namespace kincal {

/// Parses a YAML text. @throws InputError with path:line:column on malformed text and on a
/// duplicate key of a mapping.
Node parse_yaml(const std::string& text, const std::string& path);

/// Writes the tree as block mappings (those of up to 3 simple values in one line) and flow
/// sequences of scalars (where they fit a line); strings are quoted where needed, keys also where
/// readers of YAML 1.1 or 1.2 would take them for something else (text_node()). The text reads
/// back as the same tree (odd plain texts become quoted). Comments are not kept.
std::string to_yaml(const Node& node);

/// Makes a scalar that is a text: quoted where readers of YAML 1.1 or 1.2 would take it for a
/// number, a date, a truth value or nothing.
Node text_node(const std::string& text);

/// Writes a text as such a scalar, quoted where it must be in a list of one line too.
std::string yaml_text(const std::string& text);

}  // namespace kincal
