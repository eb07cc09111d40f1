// Words for messages: numbers in printf's formats, names in quotes, lists.
#pragma once

#include <cstddef>
#include <string>
#include <vector>

namespace kincal {

/// printf's text; up to 300 characters.
std::string text(const char* format, ...) __attribute__((format(printf, 1, 2)));

/// 'name'
std::string quoted(const std::string& name);
/// "'a', 'b', 'c' and 4 more": the first `most` names.
std::string joined(const std::vector<std::string>& names, std::size_t most = 12);
/// "a", "a and b", "a, b and c", "a, b, c and 4 more".
std::string listed(const std::vector<std::string>& names, std::size_t most = 3);

/// "3 degrees", from rad.
std::string angle_text(double rad);
/// "3 mm", from m.
std::string length_text(double m);

}  // namespace kincal
