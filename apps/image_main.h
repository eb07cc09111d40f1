// The end of the programs that know images, kincal-detect and kincal-render.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace kincal {

/// As run_program, with OpenCV made quiet and single-threaded.
int run_image_program(CLI::App& app, int argc, char** argv, const std::function<int()>& work);

}  // namespace kincal
