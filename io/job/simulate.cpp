#include "simulate.h"

#include "../../models/rig/selection.h"
#include "../rig/simulation_file.h"

namespace kincal {
namespace {

/// Where something is that the rig gives no pose for must be said, by the truth or a spread at
/// least.
void refuse_open_poses(const Rig& rig, const ParameterTable& table, const VectorXd& truth,
                       const SimulateSettings& settings) {
  std::vector<char> said(table.all.size(), 0);
  for (const Spread& s : settings.spread)
    for (const Freed& f : table.select(s.pattern)) said[f.parameter] = 1;
  for (int p : open_poses(rig, table)) {
    const Parameter& parameter = table.all[p];
    if (said[p] || truth.segment<12>(parameter.start) != table.initial.segment<12>(parameter.start))
      continue;
    const bool sensor = parameter.kind == ParameterKind::sensor_pose;
    const std::string& name =
        sensor ? rig.sensors[parameter.owner].name : rig.targets[parameter.owner].name;
    const bool switches = settings.words == Words::switches;
    throw InputError("simulate: " + parameter.name + " is missing in the rig, so it is not known " +
                     "where " + (sensor ? "sensor '" : "target '") + name + "' is: write " +
                     (sensor ? "sensors." + name + ".pose" : "targets." + name + ".mount.pose") +
                     " into the rig, or give it by " + option_name("truth", settings.words) +
                     ", or draw it by " +
                     (switches ? "--spread '" + parameter.name + "=0.01'"
                               : "spread={'" + parameter.name + "': 0.01}") +
                     " (around the identity)");
  }
}

std::vector<std::string> warnings_of(const Rig& rig, const Simulation& simulation, int samples) {
  std::vector<std::string> out;
  for (const Simulation::Dropped& d : simulation.dropped)
    out.push_back("sample '" + d.sample + "': sensor '" + rig.sensors[d.sensor].name +
                  "' does not see target '" + rig.targets[d.target].name + "': " + d.why);
  for (int s : simulation.idle)
    out.push_back("sensor '" + rig.sensors[s].name + "' " +
                  (rig.sensors[s].type == "chain" ? "holds" : "sees") + " nothing");
  if (simulation.samples.size() < static_cast<size_t>(samples))
    out.push_back(std::to_string(static_cast<size_t>(samples) - simulation.samples.size()) +
                  " of " + std::to_string(samples) +
                  " samples are left out: in these postures no sensor sees a whole target from its "
                  "printed side");
  return out;
}

}  // namespace

SimulatedJob simulate_samples(const RigFile& rig_file, const SimulateSettings& settings,
                              const Progress& progress) {
  ParameterTable table(rig_file.rig);
  SimulationOptions options;
  options.seed = settings.seed;
  options.samples = settings.samples;
  options.progress = progress;
  if (settings.postures)
    options.postures =
        parse_postures(settings.postures->text, settings.postures->path, rig_file.rig);
  VectorXd truth = table.initial;
  if (settings.truth) truth = parse_truth(settings.truth->text, settings.truth->path, table);
  try {
    if (!settings.spread.empty()) truth = draw_truth(table, settings.spread, settings.seed);
  } catch (const NameError& error) {
    throw with_nearest(error, settings.words);
  }
  refuse_open_poses(rig_file.rig, table, truth, settings);
  Simulation simulation = simulate(rig_file.rig, table, truth, options);
  std::vector<std::string> warnings = warnings_of(rig_file.rig, simulation, settings.samples);
  return {std::move(table), std::move(simulation), std::move(warnings)};
}

}  // namespace kincal
