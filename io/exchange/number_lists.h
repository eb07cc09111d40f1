// Arrays of numpy, and lists of numbers in YAML and JSON files of other programs, as tables.
#pragma once

#include <string>
#include <vector>

#include "table.h"

namespace kincal {

bool is_numpy(const std::string& bytes);

/// Reads an array of numbers (.npy): N x n, or N x 4 x 4 and N x 3 x 4 as rows of 16 and 12.
/// @throws InputError with path: other kinds of numbers or shapes, a file that ends too soon
Table numpy_table(const std::string& bytes, const std::string& path);

/// Whether a file is YAML, JSON or XML of OpenCV, by its name and beginning.
bool has_number_lists(const std::string& text, const std::string& path);

/// Reads every list of a file whose items are alike: matrices (nested lists, or rows, cols and data
/// as OpenCV and ViSP write them), lists of numbers, mappings of numbers (x, y, z, qx, ...), and
/// transforms (translation and rotation; position and orientation). Lists under the same keys are
/// one table. @throws InputError
std::vector<Table> list_tables(const std::string& path);

}  // namespace kincal
