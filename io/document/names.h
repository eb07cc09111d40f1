// Names in messages: the nearest ones to a misspelt one, and lists of them.
#pragma once

#include <string>
#include <vector>

namespace kincal {

/// Returns "; nearest: a, b, c" by edit distance, or "" if nothing is near.
std::string nearest_names(const std::string& name, const std::vector<std::string>& names);

/// Returns all names in their order: "a, b, c".
std::string comma_separated(const std::vector<std::string>& names);

}  // namespace kincal
