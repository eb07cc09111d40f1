// `kincal calibrate`: estimate what the rig's steps free.
#include <cstdio>
#include <iostream>

#include "../../io/document/files.h"
#include "../../models/trials/groups.h"
#include "../job.h"
#include "../tables/plan_table.h"
#include "../tables/progress.h"
#include "../tables/report_table.h"
#include "command.h"

namespace kincal {
namespace {

struct CalibrateArguments {
  std::string rig, samples, out;
  CalibrateSettings settings;
  bool force = false, dry_run = false, quiet = false, json = false;
};

constexpr double kBad = 5;  // chi2/dof that asks for an explanation

/// What may be wrong with the input of a calibration that ended badly. Nothing: interrupted.
std::optional<Diagnosis> look_for_mistakes(const Job& job, const CalibrateSettings& settings) {
  DoctorOptions options;
  options.noise = kNoiseModes.at(settings.noise);
  options.threads = settings.threads;
  options.progress = [](int, int) { return not_interrupted(); };
  return diagnose(job.rig_file.rig, job.calibration.samples(), options);
}

int calibrate(const CalibrateArguments& a) {
  if (!a.dry_run) {
    if (a.out.empty()) throw InputError("calibrate: --out DIR is required (only --dry-run does without)");
    check_output(a.out, a.force);
  }
  Job job = read_job(a.rig, a.samples, a.settings.holdout);
  for (const std::string& warning : job.rig_file.urdf.warnings) std::fprintf(stderr, "kincal: warning: %s\n", warning.c_str());
  check_validation(job, a.settings);
  if (a.dry_run && job.rig_file.rig.steps.empty()) {
    std::cout << staging_plan(staging_groups(job.rig_file.rig, job.calibration.samples()));
    return kConverged;
  }
  if (a.dry_run) {
    std::cout << plan_table(plan(job, a.settings), job.calibration.table());
    return kConverged;
  }
  Progress progress(a.quiet || a.json);
  std::optional<CalibrationResult> result;
  try {
    result = run(job, a.settings, [&](const std::string& step, int iteration, double chi2, double damping) {
      progress.update(step, iteration, chi2, damping);
      return not_interrupted();
    });
  } catch (const InputError&) {
    throw;
  } catch (const std::runtime_error& error) {  // undefined at the start
    progress.interrupted();
    const std::optional<Diagnosis> diagnosis = look_for_mistakes(job, a.settings);
    if (!diagnosis) return say_interrupted();
    throw std::runtime_error(error.what() + ("\nWhat may be wrong (kincal check):\n" + diagnosis_text(*diagnosis)));
  }
  if (result && not_interrupted() && (result->status != Status::converged || result->chi2 > kBad * static_cast<double>(result->dof)))
    if (!(result->diagnosis = look_for_mistakes(job, a.settings))) result.reset();
  if (!result || !not_interrupted()) {
    progress.interrupted();
    return say_interrupted();
  }
  progress.finish();
  const ResultFiles files = make_files(job, *result, a.settings);
  if (!write_results(a.out, files, a.force, not_interrupted)) return say_interrupted();
  if (a.json)
    std::cout << files.result_json;
  else if (!a.quiet)
    std::cout << report(*result, files) << "\nWritten to " << a.out << "\n";
  for (const Judgement& j : result->validation.requirements)
    if (!j.met && std::cout.flush()) std::fprintf(stderr, "kincal: error: not met: %s\n", judgement_text(j).c_str());
  return exit_code(*result);
}

}  // namespace

Command calibrate_command(CLI::App& app, const std::string& command_line) {
  auto a = std::make_shared<CalibrateArguments>();
  a->settings.command = command_line;
  CLI::App* command = app.add_subcommand("calibrate", "Estimate the parameters that the rig's steps free and write a result directory");
  command->add_option("RIG", a->rig, "rig.yaml: robot, sensors, targets, steps")->required();
  command->add_option("SAMPLES", a->samples, "samples.jsonl: one posture of the robot a line")->required();
  command->add_option("--out", a->out, "new directory for robot.urdf, rig.yaml, result.json, changes.yaml, covariance.csv, residuals.csv");
  add_settings(*command, a->settings);
  command
      ->add_option("--restarts", a->settings.restarts,
                   "run all steps N times more from other starting values and tell whether they end in the same minimum")
      ->check(CLI::Range(1, 10000))
      ->type_name("N");
  command->add_flag("--force", a->force, "replace an existing result");
  command->add_flag("--dry-run", a->dry_run, "only print what each step frees, the counts and the degrees of freedom");
  command->add_flag("--quiet", a->quiet, "print errors only");
  command->add_flag("--json", a->json, "print result.json on standard output instead of tables");
  command->footer(
      "Parameters: joint/NAME/offset, /scale, /origin[.x .y .z .rx .ry .rz]; sensor/NAME/pose, /intrinsics[.fx ...], /distortion, "
      "/baseline;\n"
      "target/NAME/pose, /square, /points; geometry/BASE..TIP (two links): the independent numbers of a chain. A rig without `estimate` "
      "is\n"
      "staged automatically: what lowers the error on samples left out of the fit is freed. `*` in globs crosses `/`. The tables show rms "
      "before and after; `as read` takes the joint "
      "readings\n"
      "as exact: what the robot's own software will see.\n"
      "Exit codes: 0 converged; 1 bad input, nothing written; 2 a freed direction is not determined; 3 a step did not converge; 4 a\n"
      "--require is not met (2, 3, 4: results are written, result.json says so; where several apply 3 goes before 2 before 4); 130\n"
      "interrupted, nothing written.");
  return {command, [a] { return calibrate(*a); }};
}

}  // namespace kincal
