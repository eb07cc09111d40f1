// The programs that need OpenCV (kincal-detect, kincal-render), which kincal becomes.
#pragma once

#include <string>
#include <vector>

namespace kincal {

/// Returns where a program is: beside this one, in libexec, or in the PATH. `what` asks for it.
/// @throws InputError that says what to install
std::string find_image_program(const std::string& name, const std::string& what);

/// Replaces this program by another; the first argument is its name. @throws InputError
[[noreturn]] void become(const std::string& path, std::vector<std::string> arguments);

}  // namespace kincal
