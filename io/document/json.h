// JSON text to a tree of nodes, and the parts of JSON text that this program writes by itself.
#pragma once

#include <functional>
#include <string>
#include <string_view>

#include "../../solver/progress.h"
#include "document.h"
#include "node.h"

namespace kincal {

/// Parses one JSON value; `line` is that of the text's first line.
/// @throws InputError with path:line:column on malformed text, on a duplicate key, on NaN, Infinity
/// and numbers beyond double.
Node parse_json(const std::string& text, const std::string& path, int line = 1);

/// Parses what machines write in one line, many times faster: numbers become Node::numbers, columns
/// are unknown (0). False: the text is malformed or has something rare (escapes, other than ASCII,
/// lists of unlike things), and parse_json() decides.
bool parse_plain_json(std::string_view text, int line, Node& node);

/// Visits the values of the text of a JSON lines file, one a line, blank lines aside. `read`
/// returns the value's id. It gets a line by parse_plain_json() first; if it throws InputError,
/// again by parse_json(), whose error then counts. @throws InputError where a line is malformed or
/// an id stands twice; Cancelled.
void for_each_json_line(const std::string& text, const std::string& path,
                        const std::function<std::string(const Field&)>& read,
                        const Progress& progress = {});

/// Whether a text is UTF-8, as every JSON file has to be.
bool is_utf8(const std::string& text);

/// Writes a text as a JSON string; its bytes above ASCII stay as they are.
std::string json_string(const std::string& text);

}  // namespace kincal
