// A text between double quotes, for the writers of YAML and JSON. This header is internal to this
// folder.
#pragma once

#include <string>

namespace kincal {

enum class Quoting { yaml, json };

/// Returns the text between double quotes. Quotes, backslashes and control characters in it are
/// escaped; bytes above ASCII stay as they are.
std::string quoted_text(const std::string& text, Quoting quoting);

}  // namespace kincal
