#include "numbers.h"

#include <charconv>
#include <cmath>
#include <system_error>

namespace kincal {

bool starts_with_zero(std::string_view digits) {
  return digits.size() > 1 && digits[0] == '0' && digits[1] >= '0' && digits[1] <= '9';
}

bool read_number(std::string_view text, double& value) {
  if (!text.empty() && text[0] == '+') {
    text.remove_prefix(1);
    if (!text.empty() && text[0] == '-') return false;
  }
  if (starts_with_zero(text.substr(!text.empty() && text[0] == '-'))) return false;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  return error == std::errc() && end == text.data() + text.size() && std::isfinite(value);
}

std::string shortest(double value) {
  if (value == 0) return "0";
  char buffer[32];
  std::string out(buffer, std::to_chars(buffer, buffer + sizeof buffer, value).ptr);
  const size_t exponent = out.find('e');  // YAML 1.1 takes 4e-04 for a text
  if (exponent != std::string::npos && out.find('.') == std::string::npos)
    out.insert(exponent, ".0");
  return out;
}

std::string shortest(const Vector3d& v) {
  return shortest(v.x()) + " " + shortest(v.y()) + " " + shortest(v.z());
}

std::string list_text(const double* values, int count) {
  std::string out = "[";
  for (int i = 0; i < count; ++i) out += (i ? ", " : "") + shortest(values[i]);
  return out + "]";
}

std::string rounded(double value, int digits) {
  char text[40];
  const auto end = std::to_chars(text, text + sizeof text, value == 0 ? 0.0 : value,
                                 std::chars_format::general, digits);
  return std::string(text, end.ptr);
}

std::array<double, 7> pose_numbers(const Pose& pose) {
  const Eigen::Vector4d q = quaternion_from_rotation(pose.rotation);
  const Vector3d& t = pose.translation;
  return {t.x(), t.y(), t.z(), q(0), q(1), q(2), q(3)};
}

}  // namespace kincal
