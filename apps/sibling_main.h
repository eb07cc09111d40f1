// The `main` of the programs that kincal becomes.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>

namespace kincal {

/// Reads the arguments and does the work; says on stderr what went wrong. Returns the exit code.
int run_program(CLI::App& app, int argc, char** argv, const std::function<int()>& work);

}  // namespace kincal
