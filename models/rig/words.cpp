#include "words.h"

#include <locale.h>  // of POSIX

#include <cstdarg>
#include <cstdio>

#include "numbers.h"

namespace kincal {

std::string text(const char* format, ...) {
  static const locale_t plain = newlocale(LC_ALL_MASK, "C", nullptr);
  char buffer[512];
  va_list arguments;
  va_start(arguments, format);
  const locale_t before = uselocale(plain);  // of this thread: the host's may have decimal commas
  std::vsnprintf(buffer, sizeof buffer, format, arguments);
  uselocale(before);
  va_end(arguments);
  return buffer;
}

std::string quoted(const std::string& name) { return "'" + name + "'"; }

std::string joined(const std::vector<std::string>& names, std::size_t most) {
  std::string out;
  for (std::size_t i = 0; i < names.size() && i < most; ++i)
    out += (i ? ", " : "") + quoted(names[i]);
  if (names.size() > most) out += " and " + std::to_string(names.size() - most) + " more";
  return out;
}

std::string listed(const std::vector<std::string>& names, std::size_t most) {
  std::string out;
  const std::size_t shown = names.size() <= most + 1 ? names.size() : most;
  for (std::size_t i = 0; i < shown; ++i)
    out += (i == 0 ? "" : i + 1 == names.size() ? " and " : ", ") + names[i];
  if (shown < names.size()) out += " and " + std::to_string(names.size() - shown) + " more";
  return out;
}

std::string angle_text(double rad) { return text("%.3g degrees", rad * 180 / kPi); }
std::string length_text(double m) { return text("%.3g mm", m * 1e3); }

}  // namespace kincal
