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
  CLI::App* command = app.add_subcommand("fleet",
                                         "Compare results of many robots, or of one robot over "
                                         "time: find robots unlike the others, and drift");
  command
      ->add_option("DIR", a->results,
                   "result directories of calibrate or batch, or folders of them (for example the "
                   "--out of a batch)")
      ->required();
  command
      ->add_option("--out", a->out,
                   "new directory for fleet.json, robots.csv, family.csv, drift.csv")
      ->required();
  command
      ->add_option("--level", a->level,
                   "share of healthy robots reported by chance; a smaller value gives fewer false "
                   "alarms and fewer detections")
      ->check(CLI::Range(1e-9, 0.5))
      ->capture_default_str();
  command
      ->add_option("--anew", a->anew,
                   "name or pattern of parameters that change with every recording, for example "
                   "the pose of a board that is set up\n"
                   "anew; not counted as drift; may be repeated (default: target/*/pose)")
      ->allow_extra_args(false)
      ->type_name("NAME");
  command->add_flag("--json", a->json, "print fleet.json instead of tables");
  command->add_flag("--force", a->force, "replace an existing output");
  command->add_flag("--quiet", a->quiet, "print errors only");
  command->footer(
      "Robot and date: `serial` and `time` at the top of rig.yaml; else the folder's name (NAME, "
      "or NAME-2026-03-01, or\n"
      "ROBOT/2026-03-01) and the date of the calibration. The latest result of each robot is "
      "compared with the latest results of all\n"
      "others; a robot with several results is also compared with itself over time. Only the data "
      "count, not the priors.\n"
      "The worst come first: p is the probability that a healthy robot looks this bad. Read `What "
      "would explain it alone` first:\n"
      "it names the parameter, and the others that the data cannot distinguish from it "
      "(family.csv, drift.csv).\n"
      "Example:\n"
      "  kincal batch robots --out results && kincal fleet results --out fleet\n"
      "Exit codes: 0 nothing was found; 1 bad input, nothing written; 4 a robot is out of family "
      "or has changed, results are\n"
      "written; 130 interrupted, nothing written.");
  return {command, [a] { return fleet(*a); }};
}

}  // namespace kincal
