#include "quoting.h"

namespace kincal {

std::string quoted_text(const std::string& text, Quoting quoting) {
  static const char* const hex = "0123456789abcdef";
  const bool yaml = quoting == Quoting::yaml;
  std::string out = "\"";
  for (const unsigned char c : text) {
    if (c == '"' || c == '\\') {
      out += {'\\', static_cast<char>(c)};
    } else if (yaml && c == '\n') {
      out += "\\n";
    } else if (yaml && c == '\t') {
      out += "\\t";
    } else if (c < 0x20 || (yaml && c == 0x7f)) {
      out += yaml ? "\\x" : "\\u00";
      out += {hex[c >> 4], hex[c & 15]};
    } else {
      out += static_cast<char>(c);
    }
  }
  return out + "\"";
}

}  // namespace kincal
