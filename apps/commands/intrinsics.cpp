// `kincal intrinsics`: lenses and stereo from views of boards, without a robot.
#include <cmath>
#include <cstdio>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/results/intrinsics_file.h"
#include "../../io/rig/samples_file.h"
#include "../../models/doctor/camera_mistakes.h"
#include "../../models/doctor/plausibility.h"
#include "../job.h"
#include "../signals.h"
#include "../tables/intrinsics_table.h"
#include "command.h"

namespace kincal {
namespace {

struct IntrinsicsArguments {
  std::string rig, samples, out, command;
  IntrinsicsOptions options;
  bool json = false, force = false, quiet = false;
};

ExitCode exit_code_of(Status status) {
  return status == Status::unobservable    ? kUnobservable
         : status == Status::not_converged ? kNotConverged
         : status == Status::unexplained   ? kNotExplained
                                           : kConverged;
}

int intrinsics(const IntrinsicsArguments& a) {
  say_cleared(clear_leftovers(a.out));
  check_output(a.out, a.force);
  const RigFile rig_file = read_rig(rig_path(a.rig));
  now("reading " + a.samples);
  ProgressLine line(a.quiet || a.json);
  const std::string text = read_file(a.samples);  // once: it may be a pipe
  const std::vector<Sample> samples =
      parse_samples(text, a.samples, without_robot(rig_file.rig), line);
  for (const Notice& finding : find_normalised(rig_file.rig, samples))
    throw InputError(sentences(finding));
  now("calibrating cameras");
  IntrinsicsOptions options = a.options;
  options.progress = line.progress();
  std::optional<IntrinsicsResult> result = calibrate_intrinsics(rig_file.rig, samples, options);
  if (!result) return say_interrupted();
  for (const Notice& finding : find_implausible(rig_file.rig, samples))
    if (finding.kind == NoticeKind::square)
      result->notes.push_back({id(finding.kind), sentences(finding)});
  line.stage("writing", std::nan(""));
  const auto files = intrinsics_files(rig_file, *result, {KINCAL_VERSION, a.command, sha256(text)});
  begin_writing();
  if (!write_directory(a.out, files, a.force, not_interrupted)) return say_interrupted();
  line.clear();
  if (a.json) {
    for (const auto& [name, content] : files)
      if (name == "intrinsics.json") std::cout << content;
  } else if (!a.quiet) {
    std::cout << intrinsics_table(rig_file.rig, *result) << "\nWritten to " << a.out << "\n";
  }
  for (const IntrinsicsNote& note : result->notes)
    std::fprintf(stderr, "kincal: warning: %s\n", note.text.c_str());
  for (const std::string& name : names_without_parameter(rig_file, *result))
    std::fprintf(stderr,
                 "kincal: warning: '%s' in the rig's steps has no meaning with the new lens: "
                 "delete it from rig.yaml\n",
                 name.c_str());
  return exit_code_of(result->status);
}

}  // namespace

Command intrinsics_command(CLI::App& app, const std::string& command_line) {
  auto a = std::make_shared<IntrinsicsArguments>();
  a->command = command_line;
  CLI::App* command = app.add_subcommand(
      "intrinsics",
      "Calibrate lenses and camera poses (stereo) from views of boards, without a robot");
  command->add_option("RIG", a->rig, "rig.yaml with cameras and boards")->required();
  command
      ->add_option("SAMPLES", a->samples,
                   "samples.jsonl with views of the boards; joint readings are not needed")
      ->required();
  command
      ->add_option("--out", a->out,
                   "new directory for rig.yaml, robot.urdf, intrinsics.json, coverage.svg")
      ->required();
  std::vector<std::string> models = {"auto", "rig"};
  for (const auto* lenses : {&lens_models(), &further_lens_models()})
    for (const LensModel& model : *lenses) models.push_back(model.name);
  command
      ->add_option("--model", a->options.model,
                   "lens model: the simplest that is not worse on held-out samples (auto), each "
                   "camera's own (rig), or a name; the number in a name\n"
                   "counts coefficients, in the order k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x "
                   "tau_y; auto does not try 2, 12 and 14, unified and double_sphere")
      ->check(CLI::IsMember(models))
      ->capture_default_str();
  command
      ->add_option(
          "--folds", a->options.folds,
          "split the samples into so many parts and leave each out once; at most one per sample")
      ->check(CLI::Range(2, 1000))
      ->capture_default_str();
  command->add_flag(
      "--warp", a->options.warp,
      "estimate the warp of boards (two components each) if that is better on held-out samples");
  command->add_flag("--json", a->json, "print intrinsics.json instead of tables");
  command->add_flag("--force", a->force, "replace an existing result");
  command->add_flag("--quiet", a->quiet, "print errors only");
  command->footer(
      "Every board is free, wherever the rig mounts it. Cameras on one rigid body that see a board "
      "in the same sample are\n"
      "calibrated together, including their poses relative to the first camera. The rig's "
      "intrinsics may be guesses.\n"
      "Recording: 15 to 30 views of a flat board, tilted by 20 to 45 degrees to all sides, at the "
      "distance of use, with board corners\n"
      "out to the edges and corners of the image. One view, or parallel views, do not determine a "
      "focal length. The tables show the\n"
      "lens models tried, values with sigmas, the coverage of the image, and the sigma of a "
      "projected point (docs/intrinsics.md).\n"
      "Example:\n"
      "  kincal intrinsics rig.yaml samples.jsonl --out lens && kincal calibrate lens "
      "samples.jsonl --out result\n"
      "Exit codes: 0 converged; 1 bad input, nothing written; 2 the views do not determine the "
      "lens, 3 no convergence, or 5\n"
      "the views do not match the board of the rig: results are written and marked; 130 "
      "interrupted, nothing written.");
  return {command, [a] { return intrinsics(*a); }};
}

}  // namespace kincal
