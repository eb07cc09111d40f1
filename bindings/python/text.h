// Texts between Python and C++.
#pragma once

#include <pybind11/pybind11.h>

#include <string>
#include <utility>

namespace kincal {

/// A Text is what stands in a file, or its path: bytes that are no UTF-8 come and go as Python has
/// them (surrogateescape).
struct Text : std::string {
  Text() = default;
  Text(std::string text) : std::string(std::move(text)) {}
};

}  // namespace kincal

namespace pybind11::detail {
template <>
struct type_caster<kincal::Text> {
  PYBIND11_TYPE_CASTER(kincal::Text, const_name("str"));

  bool load(handle source, bool) {
    if (!PyUnicode_Check(source.ptr())) return false;
    const auto bytes = reinterpret_steal<object>(
        PyUnicode_AsEncodedString(source.ptr(), "utf-8", "surrogateescape"));
    if (!bytes) throw error_already_set();
    value = kincal::Text(bytes.cast<std::string>());
    return true;
  }
  static handle cast(const kincal::Text& text, return_value_policy, handle) {
    return PyUnicode_DecodeUTF8(text.data(), static_cast<ssize_t>(text.size()), "surrogateescape");
  }
};
}  // namespace pybind11::detail
