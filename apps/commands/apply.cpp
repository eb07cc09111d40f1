// `kincal apply`: the changes of a result put into another copy of the robot.
#include <filesystem>
#include <iostream>

#include "../../io/document/error.h"
#include "../../io/document/files.h"
#include "../../io/results/apply.h"
#include "../job.h"
#include "../signals.h"
#include "command.h"

namespace kincal {
namespace {

struct ApplyArguments {
  std::string result, urdf, out;
  bool force = false;
};

int apply(const ApplyArguments& a) {
  say_cleared(clear_leftovers(a.out));
  check_output_file(a.out, a.force);
  std::error_code ignored;
  if (std::filesystem::is_directory(a.urdf, ignored))
    throw InputError(a.urdf + ": this is a directory, no URDF; the result comes first");
  const AppliedResult applied = apply_result(a.result, read_urdf(a.urdf), a.force);
  begin_writing();
  write_file(a.out, applied.urdf, a.force);
  for (const std::string& note : applied.notes) std::cerr << "kincal: warning: " << note << "\n";
  std::cout << "Written to " << a.out << "\n";
  return kConverged;
}

}  // namespace

Command apply_command(CLI::App& app) {
  auto a = std::make_shared<ApplyArguments>();
  CLI::App* command = app.add_subcommand(
      "apply", "Put the changes of a result into another copy of the robot's URDF");
  command->add_option("RESULT", a->result, "result directory or its result.json")->required();
  command->add_option("URDF", a->urdf, "the copy; only numbers of its joint origins are replaced")
      ->required();
  command->add_option("--out", a->out, "file to write")->required();
  command->add_flag(
      "--force", a->force,
      "replace an existing file; apply a result that is not converged, not determined or not "
      "explained by the model");
  command->footer("Exit codes: 0 written; 1 bad input or usage, nothing written.");
  return {command, [a] { return apply(*a); }};
}

}  // namespace kincal
