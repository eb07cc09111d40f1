// The end of the programs that know images, kincal-detect and kincal-render.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace kincal {

/// Reads the arguments and does the work; says on stderr what went wrong. Returns the exit code.
int run_image_program(CLI::App& app, int argc, char** argv, const std::function<int()>& work);

}  // namespace kincal
