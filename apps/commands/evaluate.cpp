// `kincal evaluate`: residuals at the rig's values.
#include <cstdio>
#include <iostream>

#include "../../io/job/check.h"
#include "../../io/results/input_files.h"
#include "../../io/results/result_json.h"
#include "../job.h"
#include "../tables/report_table.h"
#include "../tables/validation_table.h"
#include "command.h"

namespace kincal {
namespace {

struct EvaluateArguments {
  std::string rig, samples, urdf, noise = "latent";
  std::vector<std::string> free;
  PageSettings page;
  bool json = false, quiet = false;
};

int evaluate(const EvaluateArguments& a) {
  check_page_file(a.page);
  RigFile rig_file = read_rig(rig_path(a.rig), a.urdf);
  ProgressLine line(a.quiet || a.json);
  const SampleSet samples = read_sample_set(a.samples, rig_file.rig, line);
  now("evaluating");
  CalibrateSettings settings;
  settings.noise = a.noise;
  settings.free = a.free;
  const EvaluatedJob evaluated =
      evaluate_samples(rig_file, samples, settings, line.progress().in("evaluating"));
  line.clear();
  const Evaluation& evaluation = evaluated.evaluation;
  if (a.json) {
    std::cout << json_text(evaluation_json(evaluation, evaluated.warnings));
  } else {
    std::cout << residual_table(evaluation.sensors, false)
              << unfinished_text(evaluation.unfinished);
    std::printf("chi2 of all samples %.8g, %ld degrees of freedom", evaluation.chi2,
                evaluation.dof);
    if (evaluation.dof > 0) std::printf(", chi2/dof %.4g", evaluation.chi2 / evaluation.dof);
    std::printf("\n");
  }
  for (const Notice& w : evaluated.warnings)
    std::fprintf(stderr, "kincal: warning: %s\n", sentences(w).c_str());
  if (!a.page.file.empty())
    write_page(a.page,
               evaluation_files(rig_file, evaluated.recording, evaluation, evaluated.warnings,
                                record_of(a.page.command, samples.hash)),
               !a.json);
  return evaluation.converged ? kConverged : kNotConverged;
}

}  // namespace

Command evaluate_command(CLI::App& app, const std::string& command_line) {
  auto a = std::make_shared<EvaluateArguments>();
  a->page.command = command_line;
  CLI::App* command = app.add_subcommand(
      "evaluate",
      "Print the residuals at the rig's values; only free targets and joint errors are estimated");
  command->add_option("RIG", a->rig, "rig.yaml")->required();
  command->add_option("SAMPLES", a->samples, "samples.jsonl")->required();
  command->add_option(
      "--urdf", a->urdf,
      "a robot that replaces the rig's; joint offsets of the rig are assumed to be in it already, "
      "scales are kept. For a calibrated robot.urdf\n"
      "use the rig.yaml beside it, which also has the parameters that a URDF cannot express");
  command
      ->add_option("--free", a->free,
                   "name or pattern of parameters to estimate anew in each split; may be repeated")
      ->allow_extra_args(false)
      ->type_name("GLOB");
  command->add_option("--noise", a->noise, "as in calibrate")
      ->check(CLI::IsMember(keys(kNoiseModes)))
      ->capture_default_str();
  add_page_settings(*command, a->page);
  command->add_flag("--json", a->json, "print {chi2, dof, sensors, warnings} as JSON");
  command->add_flag("--quiet", a->quiet, "no progress");
  command->footer(
      "Exit codes: 0 evaluated; 1 bad input or usage; 3 poses estimated for --free or a free "
      "target did not converge.");
  return {command, [a] { return evaluate(*a); }};
}

}  // namespace kincal
