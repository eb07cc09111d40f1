// Files and directories: read whole, written whole or not at all.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace kincal {

/// Returns the whole file. @throws InputError with path and reason.
std::string read_file(const std::string& path);

/// Returns whether there is a file (or what is read like one) of this path.
bool file_exists(const std::string& path);

/// Clears away what runs that were killed have left beside an output (NAME.writing-PID), and puts
/// back what one was replacing (NAME.replaced-PID). Returns a sentence for each.
std::vector<std::string> clear_leftovers(const std::string& path);

/// Refuses a file that exists unless `force`; always what is there and not a file, a symbolic link
/// to nothing, and a folder that cannot be written. @throws InputError
void check_output_file(const std::string& path, bool force);

/// Writes one file whole or not at all: under a temporary name beside it, to the disk, then a
/// rename. A symbolic link stays, what it leads to is written. `go_on` is asked before the rename;
/// false leaves nothing. Returns false if it did. @throws InputError
bool write_file(const std::string& path, const std::string& text, bool force,
                bool (*go_on)() = nullptr);

/// Puts bytes at a place of a file.
using PutBytes = std::function<void(std::uint64_t at, std::string_view bytes)>;
/// The same for a file that `fill` puts together piece by piece; what it throws leaves nothing.
bool write_file_in_pieces(const std::string& path, const std::function<void(const PutBytes&)>& fill,
                          bool force, bool (*go_on)() = nullptr);

/// Refuses an existing path unless `force` and it is empty or a directory that holds no file but
/// kincal's, and a folder `keep`; and, as for a file, where nothing can be written.
/// @throws InputError
void check_output(const std::string& directory, bool force, const std::string& keep = "");

/// Writes a directory of files (name, text) whole or not at all: under a temporary name beside it
/// (or in `scratch`, a folder of the same file system), to the disk, then a rename that replaces
/// nothing, or with `force` exchanges both. `go_on` is asked before the rename; false leaves
/// nothing. Returns false if it did. A folder `keep` of a replaced directory stays in it.
/// @throws InputError where the file system refuses.
bool write_directory(const std::string& directory,
                     const std::vector<std::pair<std::string, std::string>>& files, bool force,
                     bool (*go_on)(), const std::string& scratch = "",
                     const std::string& keep = "");

/// Returns the SHA-256 in hex.
std::string sha256(const std::string& text);

}  // namespace kincal
