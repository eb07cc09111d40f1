#include "quoting.h"

#include <string_view>

namespace kincal {
namespace {

void add_hex(std::string& out, unsigned code, int digits) {
  for (int shift = 4 * (digits - 1); shift >= 0; shift -= 4)
    out += "0123456789abcdef"[(code >> shift) & 15];
}

}  // namespace

Unprintable unprintable(const std::string& text, size_t at) {
  const auto byte = [&](size_t i) {
    return at + i < text.size() ? static_cast<unsigned char>(text[at + i]) : 0U;
  };
  if (byte(0) < 0x20 || byte(0) == 0x7f) return {byte(0), 1};
  if (byte(0) == 0xc2 && byte(1) >= 0x80 && byte(1) < 0xa0) return {byte(1), 2};
  if (byte(0) != 0xe2 && byte(0) != 0xef) return {};
  const unsigned code = (byte(0) & 15) << 12 | (byte(1) & 63) << 6 | (byte(2) & 63);
  for (const unsigned special : {0x2028U, 0x2029U, 0xfeffU, 0xfffeU, 0xffffU})
    if (code == special && byte(1) >= 0x80 && byte(2) >= 0x80) return {code, 3};
  return {};
}

std::string quoted_text(const std::string& text, Quoting quoting) {
  const bool yaml = quoting == Quoting::yaml;
  std::string out = "\"";
  for (size_t i = 0; i < text.size(); ++i) {
    const char c = text[i];
    const Unprintable special = unprintable(text, i);
    if (c == '"' || c == '\\') {
      out += {'\\', c};
    } else if (yaml && c == '\n') {
      out += "\\n";
    } else if (yaml && c == '\t') {
      out += "\\t";
    } else if (yaml && special.bytes > 0) {
      out += special.code < 0x100 ? "\\x" : "\\u";
      add_hex(out, special.code, special.code < 0x100 ? 2 : 4);
      i += special.bytes - 1;
    } else if (special.bytes == 1 && c != 0x7f) {
      out += "\\u";
      add_hex(out, special.code, 4);
    } else {
      out += c;
    }
  }
  return out + "\"";
}

}  // namespace kincal
