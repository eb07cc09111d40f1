// What a file of numbers seems to be, where nobody says it.
#pragma once

#include <string>
#include <vector>

#include "table.h"

namespace kincal {

/// Whether a file has numbers that may be poses, readings or points (and is no camera's or target's
/// file).
bool is_table(const std::string& path);

/// Returns what a file seems to have, two of its rows as they are read, and the commands to go on.
/// Of several files: the groups that their names make. @throws InputError
std::string guess_text(const std::vector<std::string>& files);

}  // namespace kincal
