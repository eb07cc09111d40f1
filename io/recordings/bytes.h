// Reading numbers from bytes, never beyond their end.
#pragma once

#include <cstdint>
#include <cstring>
#include <stdexcept>
#include <string>
#include <string_view>

namespace kincal {

/// What is damaged in a recording; readers leave that part out and go on.
struct Damage : std::runtime_error {
  using std::runtime_error::runtime_error;
};

/// What has not been read of some bytes.
struct Bytes {
  std::string_view left;

  /// The next `count` bytes. @throws Damage where there are fewer
  std::string_view take(std::uint64_t count) {
    if (count > left.size()) throw Damage("it ends too early");
    const std::string_view taken = left.substr(0, count);
    left.remove_prefix(count);
    return taken;
  }

  /// The next number, least significant byte first (`swapped`: last).
  template <class Number>
  Number number(bool swapped = false) {
    return number_at<Number>(take(sizeof(Number)), 0, swapped);
  }

  /// A text with its length before it.
  std::string_view text() { return take(number<std::uint32_t>()); }

  /// Number i of an array of numbers.
  template <class Number>
  static Number number_at(std::string_view bytes, size_t i, bool swapped) {
    static_assert(__BYTE_ORDER__ == __ORDER_LITTLE_ENDIAN__, "readers of recordings swap bytes");
    char raw[sizeof(Number)];
    std::memcpy(raw, bytes.data() + i * sizeof(Number), sizeof(Number));
    if (swapped)
      for (size_t k = 0; k < sizeof(Number) / 2; ++k)
        std::swap(raw[k], raw[sizeof(Number) - 1 - k]);
    Number out;
    std::memcpy(&out, raw, sizeof(Number));
    return out;
  }
};

}  // namespace kincal
