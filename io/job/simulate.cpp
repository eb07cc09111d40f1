#include "simulate.h"

#include <stdexcept>

#include "../../models/rig/selection.h"
#include "../../models/rig/words.h"
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

/// The poses that the rig does not have and the truth gives by increments alone; "": none.
std::string poses_from_identity(const Rig& rig, const ParameterTable& table,
                                const SimulateSettings& settings) {
  const std::vector<int> open = open_poses(rig, table);
  if (open.empty() || !settings.truth) return "";
  const VectorXd none = parse_truth(settings.truth->text, settings.truth->path, table),
                 given = parse_truth(settings.truth->text, settings.truth->path, table, open);
  std::vector<std::string> names;
  for (const int p : open) {
    const int start = table.all[p].start;
    if (none.segment<12>(start) == given.segment<12>(start)) names.push_back(table.all[p].name);
  }
  if (names.empty()) return "";
  return "the rig has no " + listed(names) + ", so " + settings.truth->path +
         " counts from the identity there: write nominal poses into the rig, or the true poses "
         "into "
         "`values` of the truth ({\"xyz\": ..., \"rpy\": ...})";
}

std::vector<std::string> warnings_of(const Rig& rig, const Simulation& simulation, int samples) {
  std::vector<std::string> out;
  for (const Simulation::Dropped& d : simulation.dropped)
    out.push_back("sample '" + d.sample + "': sensor '" + rig.sensors[d.sensor].name +
                  "' does not see target '" + rig.targets[d.target].name + "': " + d.why);
  for (int s : simulation.idle)
    out.push_back("sensor '" + rig.sensors[s].name + "' " +
                  (rig.sensors[s].type == "chain" ? "holds" : "sees") + " nothing");
  if (simulation.samples.size() < static_cast<size_t>(samples)) {
    std::string why;
    for (const auto& [reason, count] : simulation.left_out)
      why += (why.empty() ? "" : "; ") + reason + " (" + std::to_string(count) + ")";
    out.push_back(
        std::to_string(static_cast<size_t>(samples) - simulation.samples.size()) + " of " +
        std::to_string(samples) +
        " samples are left out, because in these postures no sensor sees a whole target: " + why);
  }
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
  if (settings.truth)
    truth = parse_truth(settings.truth->text, settings.truth->path, table,
                        open_poses(rig_file.rig, table));
  try {
    if (!settings.spread.empty()) truth = draw_truth(table, settings.spread, settings.seed);
  } catch (const NameError& error) {
    throw with_nearest(error, settings.words);
  }
  refuse_open_poses(rig_file.rig, table, truth, settings);
  const std::string identity = poses_from_identity(rig_file.rig, table, settings);
  Simulation simulation;
  try {
    simulation = simulate(rig_file.rig, table, truth, options);
  } catch (const std::runtime_error& error) {  // no random posture shows enough
    throw std::runtime_error(error.what() + (identity.empty() ? "" : ". Note: " + identity));
  }
  std::vector<std::string> warnings = warnings_of(rig_file.rig, simulation, settings.samples);
  if (!warnings.empty() && !identity.empty()) warnings.push_back(identity);
  return {std::move(table), std::move(simulation), std::move(warnings)};
}

}  // namespace kincal
