#include "automatic.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "../rig/numbers.h"
#include "../rig/words.h"
#include "grouped.h"

namespace kincal {

std::vector<NominalValue> nominal_values(const Solution& solution) {
  std::vector<NominalValue> out;
  const ParameterTable& table = solution.table();
  const VectorXd &now = solution.values.shared, &initial = solution.initial;
  for (const Parameter& p : table.all) {
    if (p.kind == ParameterKind::sensor_pose || p.kind == ParameterKind::target_pose ||
        p.kind == ParameterKind::joint_offset || p.kind == ParameterKind::points)
      continue;
    const int index = static_cast<int>(&p - table.all.data());
    if (std::count(table.sensor_mount.begin(), table.sensor_mount.end(), index) ||
        std::count(table.target_mount.begin(), table.target_mount.end(), index))
      continue;  // a mount has none, the origin that stands for one neither
    const int size = p.pose ? 12 : p.size();
    bool changed = now.segment(p.start, size) != initial.segment(p.start, size);
    NominalValue value;
    value.parameter = p.name;
    if (p.kind == ParameterKind::joint_origin) {  // the URDF takes up offsets there
      const int offset = table.joint_offset[p.owner];
      changed = changed || (offset >= 0 && now(table.all[offset].start) != 0);
      value.pose = get_pose(initial, p.start);
    } else {
      value.numbers.assign(initial.data() + p.start, initial.data() + p.start + size);
    }
    if (changed) out.push_back(std::move(value));
  }
  return out;
}

std::string held_text(const AutomaticNumber& n) {
  const bool metres = n.unit == "m", radians = n.unit == "rad";
  const std::string known = text("%.2g %s", n.sigma * (metres || radians ? 1e3 : 1),
                                 metres    ? "mm"
                                 : radians ? "mrad"
                                           : n.unit.c_str());
  return n.undetermined()
             ? "not determined by these data; its sigma is that of its prior (" + known + ")"
             : "no evidence that it is off its nominal value (known to " + known + ")";
}

std::vector<Step> automatic_steps(const Recording& recording, const AutomaticOptions& options) {
  const AutomaticGroups groups = groups_of(recording, options, {});
  return steps_of(recording, groups, start_factors(groups), {});
}

namespace {

bool is_kept(const AutomaticCalibration& found, const std::string& name) {
  return std::any_of(found.groups.begin(), found.groups.end(),
                     [&](const AutomaticGroup& g) { return g.name == name && !g.held; });
}

bool is_among(const std::vector<std::string>& names, const std::string& name) {
  return std::count(names.begin(), names.end(), name) > 0;
}

/// The groups of a model that a fit does not have.
FurtherModel further_model(const Model& model, const FitWithGroups& fit) {
  FurtherModel out;
  // (With the noise that was found: what a fit lacks is in it.)
  out.recording = make_recording(with_models_of(*fit.recording, *model.recording));
  const AutomaticOptions& options = model.options;
  for (WidthGroup& group : groups_of(*out.recording, options, options.begin.further).groups)
    if (std::none_of(fit.groups.groups.begin(), fit.groups.groups.end(),
                     [&](const WidthGroup& g) { return g.name == group.name; }))
      out.groups.push_back(std::move(group));
  return out;
}

/// A model with what a trial found, begun where the best fit ended.
Model grown(Model model, const FurtherTrial& trial, const FitWithGroups& best) {
  Begin& begin = model.options.begin;
  for (const std::string& name : trial.groups)
    if (!is_among(begin.further, name)) begin.further.push_back(name);
  for (size_t g = 0; g < best.groups.groups.size(); ++g)
    begin.factor[best.groups.groups[g].name] = best.factor(static_cast<Eigen::Index>(g));
  for (const auto& [name, factor] : trial.factor) begin.factor[name] = factor;
  begin.start = values_in(best, *model.recording);
  return model;
}

/// Calibrates with what a trial found, and keeps it if none of its groups lost its evidence.
void adopt(Model next, const FurtherTrial& trial, Model& model, Calibrated& best) {
  if (trial.groups.empty()) return;
  next = grown(std::move(next), trial, best.fit);
  Calibrated found = calibrate_groups(next);
  if (!found.found.solution.usable() ||
      !std::all_of(trial.groups.begin(), trial.groups.end(),
                   [&](const std::string& g) { return is_kept(found.found, g); }))
    return;
  model = std::move(next);
  best = std::move(found);
}

/// Compliances about the axes, then those across them, then loads.
void bend_joints(Model& model, Calibrated& best) {
  const std::vector<std::string> tried = best.fit.groups.further;
  const auto& kept = model.options.begin.further;
  for (const std::string name : {kCompliance, kComplianceAcross, kLoads}) {
    if (!is_among(tried, name) || is_among(kept, name) ||
        (name == kLoads && std::none_of(kept.begin(), kept.end(), is_bending)))
      continue;
    model.options.progress.stage(name);
    FurtherTrial trial;
    Model next;
    const bool now = model.recording->rig.elasticity && model.recording->rig.elasticity->rotor;
    for (const bool rotor : {false, true}) {
      if (name != kComplianceAcross && rotor != now)
        continue;  // those about axes turn with nothing
      Model one = model;
      one.recording = with_elasticity(*model.recording, rotor);
      one.options.begin.further.push_back(name);
      FurtherTrial found =
          try_model(best.fit, further_model(one, best.fit), *best.found.solution.recording);
      if (found.groups.empty() || found.gain <= trial.gain) continue;
      trial = std::move(found);
      next = std::move(one);
    }
    adopt(std::move(next), trial, model, best);
  }
}

/// What the conditions of the samples add.
void add_conditions(Model& model, Calibrated& best) {
  const std::vector<std::string> tried = best.fit.groups.further;
  for (const char* const name : {kBacklash, kTimeOffsets}) {
    if (!is_among(tried, name)) continue;
    model.options.progress.stage(name);
    Model next = model;
    next.recording =
        name == kBacklash ? with_backlash(*model.recording) : with_time_offsets(*model.recording);
    const FurtherTrial trial =
        try_model(best.fit, further_model(next, best.fit), *best.found.solution.recording);
    adopt(std::move(next), trial, model, best);
  }
}

/// Error curves of the joints.
void add_curves(Model& model, Calibrated& best) {
  std::vector<std::string> names;
  for (const std::string& name : best.fit.groups.further)
    if (is_curve(name)) names.push_back(name);
  const auto curved = [&](const std::vector<std::string>& groups) {
    std::vector<int> joints;
    for (const std::string& name : groups)
      joints.push_back(model.recording->rig.tree.find_joint(name.substr(kCurve.size())));
    Model out = model;
    out.recording = with_curves(*model.recording, joints);
    return out;
  };
  if (names.empty()) return;
  model.options.progress.stage("error curves of joints");
  FurtherTrial trial =
      try_model(best.fit, further_model(curved(names), best.fit), *best.found.solution.recording);
  while (!trial.groups.empty()) {
    Model next = grown(curved(trial.groups), trial, best.fit);
    Calibrated found = calibrate_groups(next);
    if (!found.found.solution.usable()) return;
    const size_t before = trial.groups.size();
    trial.groups.erase(
        std::remove_if(trial.groups.begin(), trial.groups.end(),
                       [&](const std::string& g) { return !is_kept(found.found, g); }),
        trial.groups.end());
    if (trial.groups.size() < before) continue;
    model = std::move(next);
    best = std::move(found);
    return;
  }
}

}  // namespace

Begin begin_at(const Solution& solution, const std::vector<AutomaticGroup>& groups) {
  Begin out;
  for (const AutomaticGroup& group : groups) {
    out.factor[group.name] = group.factor;
    if (is_further(group.name) && !group.held) out.further.push_back(group.name);
  }
  out.start = solution.values;
  return out;
}

AutomaticCalibration calibrate_automatically(const Recording& given,
                                             const AutomaticOptions& options) try {
  const bool again = options.begin.start.has_value();
  Model model{again ? make_recording(given) : without_added(given), options};
  Calibrated best = calibrate_groups(model);
  if (best.found.solution.usable()) {
    std::shared_ptr<const Solution> rigid;
    if (model.options.begin.further.empty())
      rigid = std::make_shared<const Solution>(best.found.solution);
    bend_joints(model, best);
    add_conditions(model, best);
    add_curves(model, best);
    const std::vector<std::string>& kept = model.options.begin.further;
    if (std::any_of(kept.begin(), kept.end(), corrects_readings))
      best.found.rigid = std::move(rigid);
  }
  return std::move(best.found);
} catch (const Cancelled&) {
  AutomaticCalibration out;
  out.solution.recording = make_recording(given);
  out.solution.initial = out.solution.values.shared = given.table.initial;
  out.solution.status = Status::cancelled;
  out.solution.message = "cancelled";
  return out;
}

}  // namespace kincal
