// Subcommands: what each of them is to main(). A command is a file of its own with a function below
// that adds its options to the program and returns what to run when it is the one that is asked
// for.
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

namespace kincal {

struct Command {
  CLI::App* app;
  std::function<int()> run;  // returns the exit code (ExitCode, job.h); throws std::exception with
                             // a message for the user
};

Command calibrate_command(CLI::App& app, const std::string& command_line);
Command batch_command(CLI::App& app, const std::string& command_line,
                      const std::vector<std::string>& arguments);
Command check_command(CLI::App& app, const std::string& command_line);
Command evaluate_command(CLI::App& app, const std::string& command_line);
Command monitor_command(CLI::App& app);
Command plan_command(CLI::App& app, const std::string& command_line);
Command verify_command(CLI::App& app, const std::string& command_line);
Command simulate_command(CLI::App& app);
Command apply_command(CLI::App& app);
Command show_command(CLI::App& app);
Command report_command(CLI::App& app);
Command export_command(CLI::App& app);
Command compensate_command(CLI::App& app);
Command import_command(CLI::App& app, const std::vector<std::string>& arguments);
Command init_command(CLI::App& app);
Command local_command(CLI::App& app, const std::string& command_line);
Command intrinsics_command(CLI::App& app, const std::string& command_line);
Command diff_command(CLI::App& app);
Command fleet_command(CLI::App& app);
Command completion_command(CLI::App& app);
Command detect_command(CLI::App& app, const std::vector<std::string>& arguments);

}  // namespace kincal
