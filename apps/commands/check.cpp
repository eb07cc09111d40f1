// `kincal check`: which of the usual mistakes explains the data.
#include <cstdio>
#include <iostream>
#include <map>
#include <memory>

#include "../../io/document/names.h"
#include "../../io/job/check.h"
#include "../../io/results/input_files.h"
#include "../job.h"
#include "../tables/report_table.h"
#include "command.h"

namespace kincal {
namespace {

struct CheckArguments {
  std::string rig, samples, noise = "latent";
  PageSettings page;
  int threads = 1;
  bool json = false, compare = false, quiet = false;
};

std::string open_numbers_text(const std::map<std::string, std::vector<std::string>>& open) {
  std::string out;
  for (const auto& [target, samples] : open)
    out += "Numbering: target '" + target +
           "' looks the same from several sides. The joint readings do not determine which corner "
           "is point 0 in " +
           (samples.size() == 1 ? "sample " : "samples ") + comma_separated(samples) +
           ". Check that it is the same corner in all samples (kincal detect --draw), or record "
           "postures that turn the board about other axes.\n";
  return out;
}

int check(const CheckArguments& a) {
  check_page_file(a.page);
  const RigFile rig_file = read_rig(rig_path(a.rig));
  for (const std::string& warning : rig_file.urdf.warnings)
    std::fprintf(stderr, "kincal: warning: %s\n", warning.c_str());
  ProgressLine line(a.quiet || a.json);
  const SampleSet samples = read_sample_set(a.samples, rig_file.rig, line);
  DoctorOptions options;
  options.noise = kNoiseModes.at(a.noise);
  options.threads = a.threads;
  options.compare = a.compare;
  options.progress = line.progress().in("testing hypotheses");
  now("checking");
  const CheckedJob checked = check_samples(rig_file, samples, options, Words::switches);
  const Diagnosis& diagnosis = checked.diagnosis;
  line.clear();
  if (a.json) {
    std::cout << json_text(check_json(checked));
  } else {
    std::cout << diagnosis_text(diagnosis) << open_numbers_text(checked.open_numbers)
              << (diagnosis.findings.empty() && explained(diagnosis)
                      ? "Next: kincal calibrate " + a.rig + " " + a.samples + " --out result\n"
                      : "");
  }
  if (!a.page.file.empty())
    write_page(a.page,
               check_files(rig_file, checked.recording, diagnosis, explained(diagnosis),
                           record_of(a.page.command, samples.hash)),
               !a.json);
  return kConverged;
}

}  // namespace

Command check_command(CLI::App& app, const std::string& command_line) {
  auto a = std::make_shared<CheckArguments>();
  a->page.command = command_line;
  CLI::App* command = app.add_subcommand(
      "check", "Test the usual mistakes as hypotheses and report which one explains the data");
  command->add_option("RIG", a->rig, "rig.yaml")->required();
  command->add_option("SAMPLES", a->samples, "samples.jsonl")->required();
  command->add_option("--noise", a->noise, "as in calibrate")
      ->check(CLI::IsMember(keys(kNoiseModes)))
      ->capture_default_str();
  command
      ->add_option("--threads", a->threads, "number of threads; the result does not depend on it")
      ->check(CLI::Range(1, 1024))
      ->capture_default_str();
  add_page_settings(*command, a->page);
  command->add_flag("--json", a->json,
                    "print {findings, chi2, dof, verdict, tested, open_numbering} as JSON");
  command->add_flag("--compare", a->compare,
                    "with --json: also `alternatives`, the log odds of each mistake tried with all "
                    "samples against the data unchanged");
  command->add_flag("--quiet", a->quiet, "no progress");
  command->footer(
      "Looks for: wrong board sizes, rows and columns exchanged, boards numbered from another "
      "corner, mirrored images or points, joints with\n"
      "the wrong sign or in degrees, joints that never move, inverted poses, cameras and targets "
      "on the wrong side, exchanged cameras,\n"
      "rectified images, duplicate samples, sensors without a connection to the others, readings "
      "that do not match the views of\n"
      "their sample, readings shifted by a sample or a time, sensors and targets on a wrong link, "
      "sigmas wrong by a factor of 5 or more,\n"
      "points outside the image, intrinsics in the wrong order, lengths in millimetres.\n"
      "Exit codes: 0 checked, whatever was found (--json for programs); 1 bad input; 130 "
      "interrupted.");
  return {command, [a] { return check(*a); }};
}

}  // namespace kincal
