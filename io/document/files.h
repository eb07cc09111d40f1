// Files and directories: read whole, written whole or not at all.
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace kincal {

/// Returns the whole file. @throws InputError with path and reason.
std::string read_file(const std::string& path);

/// Writes one file through a temporary name. @throws InputError
void write_file(const std::string& path, const std::string& text);

/// Refuses an existing path unless `force` and it is empty or a directory that holds no file but
/// kincal's. @throws InputError
void check_output(const std::string& directory, bool force);

/// Writes a directory of files (name, text) whole or not at all: under a temporary name beside it
/// (or in `scratch`, a folder of the same file system), then a rename. `go_on` is asked before the
/// rename; false leaves nothing. Returns false if it did.
/// @throws InputError where the file system refuses.
bool write_directory(const std::string& directory,
                     const std::vector<std::pair<std::string, std::string>>& files, bool force,
                     bool (*go_on)(), const std::string& scratch = "");

/// Returns the SHA-256 in hex.
std::string sha256(const std::string& text);

}  // namespace kincal
