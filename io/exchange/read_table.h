// Tables of numbers as people have them: CSV of any separator, a robot's log, frames of a KUKA
// program, matrices pasted one below the other or side by side, arrays of numpy, lists in YAML and
// JSON.
#pragma once

#include <string>
#include <vector>

#include "table.h"

namespace kincal {

/// Reads the tables of a file: one, or of YAML and JSON one for every list of poses or numbers, by
/// its keys. A matrix of 4 x 4 or 3 x 4 is a row of 16 or 12 cells wherever it stands. Separators
/// are tabs, semicolons, commas or blanks; a comma is a decimal one where something else separates.
/// @throws InputError with path and line: rows of different lengths, no row, a broken array
std::vector<Table> read_tables(const std::string& path);

/// Returns the only table of a file. @throws InputError where there are several, with their names
Table read_table(const std::string& path);

}  // namespace kincal
