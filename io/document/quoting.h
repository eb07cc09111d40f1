// A text between double quotes, for the writers of YAML and JSON. Internal to this folder.
#pragma once

#include <string>

namespace kincal {

enum class Quoting { yaml, json };

/// Quotes, backslashes and control characters are escaped; bytes above ASCII stay as they are.
std::string quoted_text(const std::string& text, Quoting quoting);

}  // namespace kincal
