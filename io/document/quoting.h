// A text between double quotes, for the writers of YAML and JSON. This header is internal to this
// folder.
#pragma once

#include <cstddef>
#include <string>

namespace kincal {

enum class Quoting { yaml, json };

/// A character that YAML demands to be escaped; bytes 0: there is none.
struct Unprintable {
  unsigned code = 0;  // of Unicode
  size_t bytes = 0;   // of UTF-8
};
/// Returns the character at `at` if it is a control character, a line separator or a byte order
/// mark: some readers of YAML end a line there, or take none.
Unprintable unprintable(const std::string& text, size_t at);

/// Returns the text between double quotes. Quotes, backslashes and control characters in it are
/// escaped, for YAML all that is not printable; other bytes above ASCII stay as they are.
std::string quoted_text(const std::string& text, Quoting quoting);

}  // namespace kincal
