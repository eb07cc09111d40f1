// `kincal calibrate`: estimate what the rig's steps free.
#include <cmath>
#include <cstdio>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/results/mount_texts.h"
#include "../job.h"
#include "../signals.h"
#include "../tables/plan_table.h"
#include "../tables/report_table.h"
#include "../tables/table.h"
#include "command.h"

namespace kincal {
namespace {

struct CalibrateArguments {
  std::string rig, samples, out;
  CalibrateSettings settings;
  bool force = false, dry_run = false, quiet = false, json = false, tables = false;
};

/// Where the result is, and where more of it is shown.
std::string where_text(const Report& report, const ResultFiles& files,
                       const CalibrateArguments& a) {
  std::string out = "Written to " + a.out;
  if (report.verdict.use != "no")
    out += files.robot_urdf.empty() ? ": rig.yaml has the calibrated values"
           : files.unbent_urdf.empty()
               ? ": robot.urdf is the calibrated robot, rig.yaml the rig "
                 "that goes with it"
               : ": robot.urdf and rig_rigid.yaml are the best robot that a "
                 "URDF can hold; rig.yaml and robot_unbent.urdf have what "
                 "it cannot, too";
  if (a.tables) return wrapped(out, "", 2);
  return wrapped(out, "", 2) +
         wrapped((a.settings.no_report ? "" : a.out + "/report.html (a browser), ") +
                     "kincal show " + shell_word(a.out) + ", or this with --tables",
                 "More: ", 2);
}

int calibrate(const CalibrateArguments& a) {
  if (!a.dry_run) {
    if (a.out.empty() && !a.json)
      throw InputError("calibrate: --out DIR is required (only --dry-run and --json do without)");
    if (!a.out.empty()) {
      say_cleared(clear_leftovers(a.out));
      check_output(a.out, a.force);
    }
  }
  ProgressLine line(a.quiet || a.json);
  Job job = read_job(a.rig, a.samples, a.settings, line);
  line.clear();
  for (const std::string& warning : job.rig_file.urdf.warnings)
    std::fprintf(stderr, "kincal: warning: %s\n", warning.c_str());
  if (!job.note.empty() && !a.quiet) std::fprintf(stderr, "kincal: %s\n", job.note.c_str());
  check_validation(job, a.settings);
  check_groups(job.rig_file.rig, a.settings);
  if (a.dry_run && job.rig_file.rig.steps.empty()) {
    check_names(job, a.settings);
    std::cout << automatic_plan(automatic_groups(job, a.settings), job.recording->table);
    return kConverged;
  }
  if (a.dry_run) {
    std::cout << plan_table(plan(job, a.settings), job.recording->table);
    return kConverged;
  }
  const Report report = run(job, a.settings, true, line);
  if (report.solution.status == Status::undefined_start)
    throw std::runtime_error(no_start_text(report.solution.message, report.diagnosis));
  line.stage("writing", std::nan(""));
  const ResultFiles files = make_files(job, report, a.settings);
  if (!a.out.empty()) {
    begin_writing();
    if (!write_results(a.out, files, a.force, not_interrupted)) return say_interrupted();
  }
  line.clear();
  if (a.json)
    std::cout << files.result_json;
  else if (!a.quiet)
    std::cout << (a.tables ? report_text(report, files) : short_text(report, files)) << "\n"
              << where_text(report, files, a);
  for (const Judgement& j : report.validation.requirements)
    if (!j.met && std::cout.flush())
      std::fprintf(stderr, "kincal: error: not met: %s\n", judgement_text(j).c_str());
  return exit_code(report);
}

}  // namespace

Command calibrate_command(CLI::App& app, const std::string& command_line) {
  auto a = std::make_shared<CalibrateArguments>();
  a->settings.command = command_line;
  CLI::App* command = app.add_subcommand(
      "calibrate",
      "Calibrate a robot: estimate the parameters of the rig and write a result directory");
  command->add_option("RIG", a->rig, "rig.yaml: robot, sensors, targets, steps")->required();
  command->add_option("SAMPLES", a->samples, "samples.jsonl: one posture of the robot per line")
      ->required();
  command->add_option("--out", a->out,
                      "new directory for robot.urdf, rig.yaml, result.json, changes.yaml, "
                      "covariance.csv, residuals.csv");
  add_settings(*command, a->settings);
  command
      ->add_option("--restarts", a->settings.restarts,
                   "run all steps N more times from other starting values and report whether they "
                   "reach the same minimum")
      ->check(CLI::Range(1, 10000))
      ->type_name("N");
  command->add_flag("--force", a->force, "replace an existing result");
  CLI::Option* dry_run = command->add_flag(
      "--dry-run", a->dry_run,
      "only print the parameters that each step estimates, the counts and the degrees of freedom");
  command->add_flag("--quiet", a->quiet, "print errors only");
  command->add_flag("--tables", a->tables,
                    "print all tables: steps, groups, loops, noise, mounts to copy, ...");
  command
      ->add_flag("--json", a->json,
                 "print result.json on standard output instead; without --out nothing is written")
      ->excludes(dry_run);
  command->footer(
      "Parameters: joint/NAME/offset, /scale, /origin[.x .y .z .rx .ry .rz]; sensor/NAME/pose, "
      "/intrinsics[.fx ...], /distortion, /baseline;\n"
      "target/NAME/pose, /square, /points; geometry/BASE..TIP (two links): the independent "
      "components of a chain. In patterns `*` also matches `/`.\n"
      "If rig.yaml has no `estimate` section, every parameter that may be wrong is estimated, with "
      "priors whose widths are learned from the data\n"
      "(--dry-run shows the groups). Parameters without evidence of error keep their nominal "
      "values. The tables show the rms before and after;\n"
      "`as read` takes the joint readings as exact, as the robot's own software does.\n"
      "Exit codes: 0 converged; 1 bad input, nothing written; 2 a combination of parameters is not "
      "determined; 3 a step did not converge; 4 a\n"
      "--require is not met; 5 the model does not explain the data (2 to 5: results are written, "
      "result.json has the status; if several\n"
      "apply, the order is 3, 2, 5, 4); 130 interrupted, nothing written.");
  return {command, [a] { return calibrate(*a); }};
}

}  // namespace kincal
