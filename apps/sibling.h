// The programs with libraries of their own (kincal-detect and kincal-render: OpenCV; kincal-bags:
// SQLite and what unpacks), which kincal becomes.
#pragma once

#include <string>
#include <vector>

namespace kincal {

/// Returns where a program is: beside this one, in libexec, or in the PATH. `what` asks for it,
/// `built`: where it is built. @throws InputError that says so
std::string find_sibling(const std::string& name, const std::string& what,
                         const std::string& built);

/// Where kincal-detect and kincal-render are built.
constexpr const char* kBuiltWithImages =
    "where OpenCV is installed: apt-get install libopencv-contrib-dev, then build kincal again "
    "(CMake option "
    "KINCAL_IMAGES)";

/// Replaces this program by another; the first argument is its name. @throws InputError
[[noreturn]] void become(const std::string& path, std::vector<std::string> arguments);

}  // namespace kincal
