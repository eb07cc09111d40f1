// Words for messages: numbers in printf's formats, names in quotes, lists.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace kincal {

/// Formats as printf does, in the C locale; the text is cut at 511 characters.
std::string text(const char* format, ...) __attribute__((format(printf, 1, 2)));

/// Returns 'name', with its quotes.
std::string quoted(const std::string& name);
/// Returns "'a', 'b', 'c' and 4 more": the first `most` names.
std::string joined(const std::vector<std::string>& names, std::size_t most = 12);
/// Returns "a", "a and b", "a, b and c" or "a, b, c and 4 more".
std::string listed(const std::vector<std::string>& names, std::size_t most = 3);

/// Returns "3 degrees", from rad.
std::string angle_text(double rad);
/// Returns "3 mm", from m.
std::string length_text(double m);

}  // namespace kincal
