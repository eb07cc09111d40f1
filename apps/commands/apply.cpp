// `kincal apply`: the changes of a result put into another copy of the robot, URDF or MJCF.
#include <filesystem>
#include <iostream>

#include "../../io/document/error.h"
#include "../../io/document/files.h"
#include "../../io/results/apply.h"
#include "../../io/urdf/edit_mjcf.h"
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
    throw InputError(a.urdf +
                     ": this is a directory, not a URDF; the result is the first argument");
  const std::string text = read_file(a.urdf);
  const AppliedResult applied = is_mjcf(text) ? apply_to_mjcf(a.result, text, a.urdf, a.force)
                                              : apply_result(a.result, read_urdf(a.urdf), a.force);
  begin_writing();
  write_file(a.out, applied.text, a.force);
  for (const std::string& note : applied.notes) std::cerr << "kincal: warning: " << note << "\n";
  std::cout << "Written to " << a.out << "\n";
  return kConverged;
}

}  // namespace

Command apply_command(CLI::App& app) {
  auto a = std::make_shared<ApplyArguments>();
  CLI::App* command = app.add_subcommand(
      "apply", "Apply a calibration to another copy of the robot model (URDF or MuJoCo)");
  command->add_option("RESULT", a->result, "result directory or its result.json")->required();
  command
      ->add_option("URDF", a->urdf,
                   "the copy: a URDF, or a MuJoCo model (MJCF) whose bodies and joints have the "
                   "names of the robot's links and joints; only values that change are replaced")
      ->required();
  command->add_option("--out", a->out, "file to write")->required();
  command->add_flag("--force", a->force,
                    "replace an existing file; apply a result that is not converged, not "
                    "determined or not explained by the model");
  command->footer("Exit codes: 0 written; 1 bad input or usage, nothing written.");
  return {command, [a] { return apply(*a); }};
}

}  // namespace kincal
