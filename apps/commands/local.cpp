// `kincal local`: joint offsets that are right around one posture.
#include <cmath>
#include <cstdio>
#include <iostream>

#include "../../io/document/files.h"
#include "../../io/results/local_file.h"
#include "../../io/rig/samples_file.h"
#include "../job.h"
#include "../signals.h"
#include "../tables/local_report.h"
#include "command.h"

namespace kincal {
namespace {

struct LocalArguments {
  std::string rig, samples, near, out, noise = "latent", command;
  double within = 1;
  bool json = false, force = false, quiet = false;
};

/// "0.31 0.42 0.5"
std::string distances_text(const std::vector<double>& distances, size_t most) {
  std::string out;
  char number[32];
  for (size_t i = 0; i < distances.size() && i < most; ++i) {
    std::snprintf(number, sizeof number, "%s%.3g", i ? " " : "", distances[i]);
    out += number;
  }
  return out.empty() ? "none" : out;
}

int local(const LocalArguments& a) {
  if (!a.out.empty()) {
    say_cleared(clear_leftovers(a.out));
    check_output_file(a.out, a.force);
  }
  const RigFile rig_file = read_rig(rig_path(a.rig));
  now("reading " + a.samples);
  ProgressLine line(a.quiet || a.json);
  const std::string text = read_file(a.samples);  // once: it may be a pipe
  const std::vector<Sample> samples = parse_samples(text, a.samples, rig_file.rig, line);
  now("calibrating around the posture");
  const LocalPosture posture = read_local_posture(a.near, rig_file.rig, samples);
  LocalOptions options;
  options.noise = kNoiseModes.at(a.noise);
  options.within = a.within;
  options.progress = line.progress().in("calibrating locally");
  const LocalCalibration local = calibrate_locally(rig_file.rig, samples, posture, options);
  line.clear();
  for (const std::string& name : local.open)
    std::fprintf(stderr,
                 "kincal: warning: %s is missing in the rig: it was estimated from the samples\n",
                 name.c_str());
  if (!local.enough) {
    std::fprintf(stderr,
                 "kincal: error: %s: %d samples within %g rad or m of the posture have views that "
                 "depend on its joints, at least %d are\n"
                 "needed. The nearest of all samples are at %s. Record postures around this one, "
                 "name fewer joints, or allow more with\n"
                 "--within\n",
                 a.samples.c_str(), local.near, a.within, kLocalSamples,
                 distances_text(local.distances, 2 * kLocalSamples).c_str());
    return kUnobservable;
  }
  const LocalSource source = {KINCAL_VERSION,        a.command,    a.near,
                              sha256(rig_file.text), sha256(text), sha256(rig_file.urdf.text)};
  const std::string yaml = local_yaml(rig_file.rig, posture, local, source);
  begin_writing();
  if (!a.out.empty()) write_file(a.out, yaml, a.force);
  if (a.json) {
    std::cout << local_json(rig_file.rig, posture, local, source);
    return kConverged;
  }
  std::cout << local_report(rig_file.rig, local);
  if (!a.out.empty()) std::cout << "\nWritten to " << a.out << "\n";
  return kConverged;
}

}  // namespace

Command local_command(CLI::App& app, const std::string& command_line) {
  auto a = std::make_shared<LocalArguments>();
  a->command = command_line;
  CLI::App* command = app.add_subcommand(
      "local", "Estimate joint offsets that are valid around one posture, on top of a calibration");
  command->add_option("RIG", a->rig, "a calibrated rig.yaml, or the result directory it is in")
      ->required();
  command->add_option("SAMPLES", a->samples, "samples.jsonl with postures around this one")
      ->required();
  command
      ->add_option("--near", a->near,
                   "the posture: a sample's id, a YAML or JSON file {joint: position}, or "
                   "joint=value,joint=value (rad, m). Joints that are\n"
                   "not named get no offset")
      ->required();
  command->add_option("--out", a->out, "file for the offsets (local.yaml)");
  command
      ->add_option("--within", a->within,
                   "samples further away than this in any of the joints are not used (rad, m)")
      ->check(CLI::PositiveNumber)
      ->capture_default_str();
  command->add_option("--noise", a->noise, "as in calibrate")
      ->check(CLI::IsMember(keys(kNoiseModes)))
      ->capture_default_str();
  command->add_flag("--json", a->json, "print the same as JSON instead of a table");
  command->add_flag("--force", a->force, "replace an existing file");
  command->add_flag("--quiet", a->quiet, "no progress");
  command->footer(
      "For a task that is always done in about the same posture (plugging in, inserting): errors "
      "that no rigid model has (stretching belts,\n"
      "bending links, imperfect gears) are nearly constant there. Do not use the offsets "
      "elsewhere; they never go into a URDF.\n"
      "Exit codes: 0 done, also if the offsets give no improvement (offsets 0, `gain: false`); 1 "
      "bad input; 2 too few samples near\n"
      "the posture, nothing written.");
  return {command, [a] { return local(*a); }};
}

}  // namespace kincal
