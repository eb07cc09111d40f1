// `kincal simulate`: samples with known truth from a rig.
#include <cstdio>

#include "../../io/document/files.h"
#include "../../io/document/names.h"
#include "../../io/rig/rig_file.h"
#include "../../io/rig/samples_file.h"
#include "../../io/rig/simulation_file.h"
#include "../../models/rig/selection.h"
#include "../job.h"
#include "../signals.h"
#include "command.h"

namespace kincal {
namespace {

struct SimulateArguments {
  std::string rig, out, truth, postures;
  std::vector<std::string> spread;
  int samples = 0;
  unsigned long long seed = 0;
  bool force = false, quiet = false;
};

/// Where something is that the rig gives no pose for must be said, by the truth or a spread at
/// least.
void refuse_open_poses(const Rig& rig, const ParameterTable& table, const VectorXd& truth,
                       const std::vector<Spread>& spread) {
  std::vector<char> said(table.all.size(), 0);
  for (const Spread& s : spread)
    for (const Freed& f : table.select(s.pattern)) said[f.parameter] = 1;
  for (int p : open_poses(rig, table)) {
    const Parameter& parameter = table.all[p];
    if (said[p] || truth.segment<12>(parameter.start) != table.initial.segment<12>(parameter.start))
      continue;
    const bool sensor = parameter.kind == ParameterKind::sensor_pose;
    const std::string& name =
        sensor ? rig.sensors[parameter.owner].name : rig.targets[parameter.owner].name;
    throw InputError("simulate: " + parameter.name +
                     " is absent from the rig, so it is not known " + "where " +
                     (sensor ? "sensor '" : "target '") + name + "' is: write " +
                     (sensor ? "sensors." + name + ".pose" : "targets." + name + ".mount.pose") +
                     " into the rig, or say it by --truth, or draw it by --spread '" +
                     parameter.name + "=0.01' (around the identity)");
  }
}

int simulate(const SimulateArguments& a) {
  say_cleared(clear_leftovers(a.out));
  check_output(a.out, a.force);
  const RigFile rig_file = read_rig(rig_path(a.rig));
  const ParameterTable table(rig_file.rig);
  SimulationOptions options;
  options.seed = a.seed;
  options.samples = a.samples;
  if (!a.postures.empty()) options.postures = read_postures(a.postures, rig_file.rig);
  VectorXd truth = table.initial;
  if (!a.truth.empty()) truth = read_truth(a.truth, table);
  std::vector<Spread> spread;
  for (const std::string& s : a.spread) {
    const size_t equals = s.rfind('=');
    Node value;
    value.kind = Node::Kind::scalar;
    value.text = equals == std::string::npos ? "" : s.substr(equals + 1);
    const std::string where = "--spread";
    if (equals == std::string::npos || equals == 0)
      throw InputError("--spread: GLOB=SIGMA is expected, not '" + s + "'");
    spread.push_back({s.substr(0, equals), Field{&value, &where, s}.number_at_least(0)});
  }
  try {
    if (!spread.empty()) truth = draw_truth(table, spread, a.seed);
  } catch (const NameError& error) {
    throw with_nearest(error);
  }
  refuse_open_poses(rig_file.rig, table, truth, spread);
  Progress progress(a.quiet);
  options.progress = [&](int done) {
    progress.stage("simulating", static_cast<double>(done) / a.samples);
    return true;
  };
  const Simulation simulation = kincal::simulate(rig_file.rig, table, truth, options);
  progress.clear();
  for (const Simulation::Dropped& d : simulation.dropped)
    std::fprintf(stderr, "kincal: warning: sample '%s': sensor '%s' does not see target '%s': %s\n",
                 d.sample.c_str(), rig_file.rig.sensors[d.sensor].name.c_str(),
                 rig_file.rig.targets[d.target].name.c_str(), d.why.c_str());
  for (int s : simulation.idle)
    std::fprintf(stderr, "kincal: warning: sensor '%s' %s nothing\n",
                 rig_file.rig.sensors[s].name.c_str(),
                 rig_file.rig.sensors[s].type == "chain" ? "holds" : "sees");
  if (simulation.samples.size() < static_cast<size_t>(a.samples))
    std::fprintf(stderr,
                 "kincal: warning: %zu of %d samples are left out: in these postures no sensor "
                 "sees a whole target from its printed side\n",
                 a.samples - simulation.samples.size(), a.samples);
  if (simulation.samples.empty())
    throw InputError("simulate: no sample is left: no posture has a view that is possible");
  const std::vector<std::pair<std::string, std::string>> files = {
      {"samples.jsonl", samples_text(rig_file.rig, simulation.samples)},
      {"truth.json", truth_text(rig_file.rig, table, simulation)}};
  begin_writing();
  if (!write_directory(a.out, files, a.force, not_interrupted)) return say_interrupted();
  std::map<int, int> views;
  for (const Sample& sample : simulation.samples)
    for (const View& view : sample.views) ++views[view.sensor];
  std::printf("%zu samples", simulation.samples.size());
  for (const auto& v : views)
    std::printf(", %s %d views", rig_file.rig.sensors[v.first].name.c_str(), v.second);
  std::printf("\nWritten to %s: samples.jsonl, truth.json\n", a.out.c_str());
  return kConverged;
}

}  // namespace

Command simulate_command(CLI::App& app) {
  auto a = std::make_shared<SimulateArguments>();
  CLI::App* command = app.add_subcommand(
      "simulate",
      "Make samples with known truth and noise from a rig: the way to try out a set-up");
  command
      ->add_option("RIG", a->rig, "rig.yaml: the nominal robot, sensors, targets and their sigmas")
      ->required();
  command->add_option("--samples", a->samples, "how many samples")
      ->required()
      ->check(CLI::Range(1, 1000000));
  command->add_option("--seed", a->seed, "the same seed makes the same samples")
      ->required()
      ->check(CLI::Range(0LL, 1LL << 62));
  command->add_option("--out", a->out, "new directory for samples.jsonl and truth.json")
      ->required();
  CLI::Option* truth_option = command->add_option(
      "--truth", a->truth, "JSON: {\"parameters\": {NAME: true value, ...}}; poses as increments");
  command
      ->add_option("--spread", a->spread,
                   "GLOB=SIGMA: draw true values around the rig's, e.g. 'joint/*/offset=0.01'")
      ->allow_extra_args(false)
      ->type_name("GLOB")
      ->excludes(truth_option);
  command->add_option("--postures", a->postures,
                      "JSON lines with postures, views and poses of targets; default: uniform "
                      "within the joint limits");
  command->add_flag("--force", a->force, "replace an existing simulation");
  command->add_flag("--quiet", a->quiet, "no progress");
  command->footer(
      "Exit codes: 0 written; 1 bad input or usage, nothing written; 130 interrupted, nothing "
      "written.");
  return {command, [a] { return simulate(*a); }};
}

}  // namespace kincal
