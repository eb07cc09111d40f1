// The program: subcommands, help, and what is common to their errors and exit codes. Everything
// else is in the libraries.

#include <malloc.h>

#include <algorithm>
#include <cctype>
#include <cstdio>
#include <exception>
#include <functional>
#include <iostream>
#include <utility>
#include <vector>

#include "../io/document/error.h"
#include "../io/document/names.h"
#include "commands/command.h"
#include "job.h"
#include "signals.h"

namespace {

const char* const kFooter =
    "Examples:\n"
    "  kincal calibrate rig.yaml samples.jsonl --dry-run          what each step estimates\n"
    "  kincal calibrate rig.yaml samples.jsonl --out result       calibrate; result/robot.urdf is "
    "the calibrated robot\n"
    "  kincal batch fleet --out results                           the same for every folder of "
    "fleet\n"
    "  kincal evaluate result/rig.yaml samples.jsonl              residuals at the calibrated "
    "values\n"
    "  kincal simulate rig.yaml --samples 30 --seed 1 --out sim --spread 'joint/*/offset=0.01'\n"
    "  kincal apply result other_copy.urdf --out calibrated.urdf\n"
    "  kincal show result                                         the summary again; "
    "result/report.html has everything\n"
    "  kincal compensate result planned.csv --tip tool0           readings for a robot whose "
    "joints bend\n"
    "  kincal export result --as camera_info --sensor camera      for ROS, OpenCV, Kalibr, "
    "easy_handeye\n"
    "  kincal local result samples.jsonl --near plugging_in --out local.yaml   joint offsets "
    "around one posture\n"
    "  kincal intrinsics rig.yaml samples.jsonl --out lens        lenses and stereo from boards, "
    "without a robot\n"
    "  kincal detect rig.yaml images --joints joints.csv --out samples.jsonl\n"
    "  kincal diff result other_result                            two calibrations compared\n"
    "  kincal monitor result new_samples.jsonl                    has anything moved since the "
    "calibration?\n"
    "  kincal plan rig.yaml --next 20 --out postures.jsonl        which postures to record, and "
    "the accuracy they give\n"
    "  kincal plan result --verify --out cycles.jsonl             the test poses of ISO 9283\n"
    "  kincal verify result new_samples.jsonl --out certificate   is it as accurate as claimed?\n"
    "  kincal fleet results --out fleet                           find robots unlike the others, "
    "and drift\n"
    "Exit codes: 0 done; 1 bad input or usage, nothing written; 130 interrupted, nothing "
    "half-written; others: "
    "see the --help of each command.";

/// The first argument that looks like an option and is none, with the nearest ones that there are;
/// else "".
std::string unknown_option(const CLI::App& command) {
  std::vector<std::string> known;
  for (const CLI::Option* option : command.get_options())
    for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
  for (const std::string& word : command.remaining()) {
    if (word.size() < 2 || word[0] != '-' || std::isdigit(static_cast<unsigned char>(word[1])) ||
        word == "--")
      continue;
    const std::string name = word.substr(0, word.find('='));
    return (command.get_parent() ? command.get_name() + ": " : std::string()) +
           "there is no option '" + name + "'" +
           kincal::nearest_names(name[1] == '-' ? name : "-" + name, known);
  }
  return "";
}

/// What an argument is, for the message that it is missing: the first line of its help.
std::string meaning(const CLI::App& command, const std::string& message) {
  const std::string::size_type end = message.find(" is required");
  for (const CLI::Option* option : command.get_options())
    if (end != std::string::npos && option->get_name() == message.substr(0, end))
      return message + " (" +
             option->get_description().substr(0, option->get_description().find_first_of("\n;")) +
             ")";
  return message;
}

/// Work matrices come and go: their memory is kept, else each is mapped and cleared anew (2 % of
/// the time of a small calibration).
void keep_memory() {
#ifdef __GLIBC__
  mallopt(M_MMAP_THRESHOLD, 1 << 25);
  mallopt(M_TRIM_THRESHOLD, 1 << 26);
  mallopt(M_TOP_PAD, 1 << 20);
#endif
}

/// Returns the exit code, unless what was printed did not get where it should.
int printed(int code) {
  if (std::cout.flush() && std::fflush(stdout) == 0 && !std::ferror(stdout)) return code;
  std::fprintf(stderr, "kincal: error: standard output cannot be written\n");
  return kincal::kBadInput;
}

}  // namespace

int main(int argc, char** argv) try {
  using namespace kincal;
  keep_standard_descriptors();
  end_on_signals();
  keep_memory();

  CLI::App app{
      "kincal calibrates robots: joint offsets, gear scales, mounts, intrinsics, baselines and "
      "target poses that best explain\n"
      "all measurements at once (bundle adjustment over kinematic chains)."};
  app.set_version_flag("--version", "kincal " KINCAL_VERSION);
  app.require_subcommand(1);
  std::string line;
  for (int i = 0; i < argc; ++i) line += (i ? " " : "") + std::string(argv[i]);
  const std::vector<std::string> arguments(argv, argv + argc),
      rest(argv + std::min(argc, 1), argv + argc);
  const std::vector<std::pair<const char*, std::function<Command()>>> makers = {
      {"init", [&] { return init_command(app); }},
      {"check", [&] { return check_command(app, line); }},
      {"calibrate", [&] { return calibrate_command(app, line); }},
      {"batch", [&] { return batch_command(app, line, arguments); }},
      {"evaluate", [&] { return evaluate_command(app, line); }},
      {"monitor", [&] { return monitor_command(app); }},
      {"plan", [&] { return plan_command(app, line); }},
      {"verify", [&] { return verify_command(app, line); }},
      {"diff", [&] { return diff_command(app); }},
      {"fleet", [&] { return fleet_command(app); }},
      {"apply", [&] { return apply_command(app); }},
      {"show", [&] { return show_command(app); }},
      {"report", [&] { return report_command(app); }},
      {"export", [&] { return export_command(app); }},
      {"compensate", [&] { return compensate_command(app); }},
      {"import", [&] { return import_command(app, rest); }},
      {"local", [&] { return local_command(app, line); }},
      {"intrinsics", [&] { return intrinsics_command(app, line); }},
      {"simulate", [&] { return simulate_command(app); }},
      {"detect", [&] { return detect_command(app, rest); }},
      {"completion", [&] { return completion_command(app); }},
  };
  // A command is made alone: the options of all take longer than some commands.
  const std::string asked = argc > 1 ? argv[1] : "";
  const bool alone = asked != "completion" &&  // which lists all
                     std::any_of(makers.begin(), makers.end(),
                                 [&](const auto& maker) { return asked == maker.first; });
  std::vector<Command> commands;
  for (const auto& [name, make] : makers)
    if (!alone || asked == name) commands.push_back(make());
  // Set last: a command without a footer of its own would take it over.
  app.footer(kFooter);
  std::vector<std::string> names;
  std::string known;
  for (const Command& command : commands) {
    command.app->set_version_flag("--version", "kincal " KINCAL_VERSION);
    names.push_back(command.app->get_name());
    known += (known.empty() ? "" : ", ") + names.back();
  }

  // Asked first: a file may be called as a command is.
  if (argc == 1 ||
      (argv[1][0] != '-' && std::find(names.begin(), names.end(), argv[1]) == names.end())) {
    const std::string what = argc == 1 ? "a command is required"
                                       : "there is no command '" + std::string(argv[1]) + "'" +
                                             nearest_names(argv[1], names);
    std::fprintf(stderr, "kincal: error: %s; known: %s. See `kincal --help`\n", what.c_str(),
                 known.c_str());
    return kBadInput;
  }
  try {
    app.parse(argc, argv);
    int code = kBadInput;
    for (const Command& command : commands)
      if (*command.app) {
        now("running `kincal " + command.app->get_name() + "`");
        code = command.run();
      }
    return printed(code);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return printed(app.exit(error));  // --help, --version
    const CLI::App& command = app.get_subcommands().empty() ? app : *app.get_subcommands()[0];
    const std::string unknown = unknown_option(command), what = meaning(command, error.what());
    std::fprintf(
        stderr, "kincal: error: %s\nRun `kincal%s --help` for more.\n",
        unknown.empty() ? what.c_str() : unknown.c_str(),
        app.get_subcommands().empty() ? "" : (" " + app.get_subcommands()[0]->get_name()).c_str());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "kincal: error: %s\n", error_text(error).c_str());
  }
  return kBadInput;
} catch (const std::exception& error) {  // before the work began; what that throws is said there
  std::fprintf(stderr, "kincal: error: %s\n", error.what());
  return kincal::kBadInput;
}
