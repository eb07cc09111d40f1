// `kincal fleet`: results of many robots, or of one over months, judged together.
#include <cmath>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/results/fleet_files.h"
#include "../job.h"
#include "../progress_line.h"
#include "../signals.h"
#include "../tables/fleet_table.h"
#include "command.h"

namespace kincal {
namespace {

struct FleetArguments {
  std::vector<std::string> results, anew;
  std::string out;
  double level = 0.01;
  bool json = false, force = false, quiet = false;
};

constexpr size_t kShown = 10;  // lines of a table
const char* const kAnew = "target/*/pose";

int fleet(const FleetArguments& a) {
  say_cleared(clear_leftovers(a.out));
  check_output(a.out, a.force);
  ProgressLine line(a.quiet || a.json);
  const std::vector<std::string> paths = find_results(a.results);
  now("reading results");
  const Fleet fleet = read_fleet(paths, line.progress().in("reading results"));
  FleetOptions options;
  options.level = a.level;
  options.anew =
      a.anew.empty() ? fleet_numbers(fleet, {kAnew}, "") : fleet_numbers(fleet, a.anew, "--anew");
  now("judging robots");
  line.stage("judging robots", std::nan(""));
  const FleetFindings findings = study_fleet(fleet.numbers, fleet.results, options);
  const std::string json = fleet_json(fleet, findings, options, KINCAL_VERSION);
  begin_writing();
  if (!write_directory(a.out,
                       {{"fleet.json", json},
                        {"robots.csv", robots_csv(fleet, findings)},
                        {"family.csv", family_csv(fleet, findings)},
                        {"drift.csv", drift_csv(fleet, findings)}},
                       a.force, not_interrupted))
    return say_interrupted();
  line.clear();
  if (a.json)
    std::cout << json;
  else if (!a.quiet)
    std::cout << fleet_table(fleet, findings, options, kShown) << "\nWritten to " << a.out << "\n";
  return findings.out_of_family + findings.drifting > 0 ? kToleranceNotMet : kConverged;
}

}  // namespace

Command fleet_command(CLI::App& app) {
  auto a = std::make_shared<FleetArguments>();
  CLI::App* command = app.add_subcommand(
      "fleet",
      "Compare results of many robots, or of one over months: who is out of family, what drifts");
  command
      ->add_option("DIR", a->results,
                   "result directories of calibrate or batch, or folders of them (such as the "
                   "--out of a batch)")
      ->required();
  command
      ->add_option("--out", a->out,
                   "new directory for fleet.json, robots.csv, family.csv, drift.csv")
      ->required();
  command
      ->add_option("--level", a->level,
                   "of healthy robots this share is named by chance; smaller: fewer false alarms, "
                   "and less is found")
      ->check(CLI::Range(1e-9, 0.5))
      ->capture_default_str();
  command
      ->add_option(
          "--anew", a->anew,
          "name or glob of numbers that are new in every result, as the place of a board that is "
          "put up\nanew: no drift of the robot; may be repeated (default: target/*/pose)")
      ->allow_extra_args(false)
      ->type_name("NAME");
  command->add_flag("--json", a->json, "print fleet.json instead of tables");
  command->add_flag("--force", a->force, "replace an existing output");
  command->add_flag("--quiet", a->quiet, "print errors only");
  command->footer(
      "Which robot and when: `serial` and `time` at the top of rig.yaml; else the folder's name "
      "(NAME, or NAME-2026-03-01, or\n"
      "ROBOT/2026-03-01) and the date of the calibration. Each robot is judged by its latest "
      "result "
      "beside the latest of all\n"
      "others; one with several results also by what changed between them. What the data say "
      "counts, "
      "without any priors.\n"
      "Worst first: p is how often a healthy robot looks so bad. `What would explain it alone` is "
      "the "
      "number to look at first:\n"
      "others that the data cannot tell from it explain it as well (family.csv, drift.csv).\n"
      "Example:\n"
      "  kincal batch robots --out results && kincal fleet results --out fleet\n"
      "Exit codes: 0 nothing was found; 1 bad input, nothing written; 4 a robot is out of family "
      "or "
      "has changed, results are\n"
      "written; 130 interrupted, nothing written.");
  return {command, [a] { return fleet(*a); }};
}

}  // namespace kincal
