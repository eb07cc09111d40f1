#include "automatic.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <memory>
#include <optional>

#include "../analysis/linearisation.h"
#include "../evidence/evidence.h"
#include "../rig/numbers.h"
#include "../rig/words.h"
#include "grouped.h"
#include "other_lens.h"
#include "ripple_search.h"

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
Model grown(Model model, const FurtherTrial& trial, const Calibrated& calibrated) {
  const FitWithGroups& best = calibrated.fit;
  model.recording = make_recording(
      with_models_of(*calibrated.found.solution.recording, *model.recording));  // with its noise
  Begin& begin = model.options.begin;
  begin.noise_factor = calibrated.found.noise_factor;
  for (const std::string& name : trial.groups)
    if (!is_among(begin.further, name)) begin.further.push_back(name);
  for (size_t g = 0; g < best.groups.groups.size(); ++g)
    begin.factor[best.groups.groups[g].name] = best.factor(static_cast<Eigen::Index>(g));
  for (const auto& [name, factor] : trial.factor) begin.factor[name] = factor;
  begin.start = values_in(best, *model.recording);
  return model;
}

/// The groups tried, and the calibrations before those kept.
struct FurtherRecord {
  std::vector<TriedGroup> tried;
  std::vector<Stage> stages;

  /// Adds the outcome of a trial. Of two trials of a group: the one that was kept, else the one
  /// with the larger gain.
  void add(const std::vector<TriedGroup>& outcomes) {
    for (const TriedGroup& one : outcomes) {
      const auto known = std::find_if(tried.begin(), tried.end(),
                                      [&](const TriedGroup& t) { return t.name == one.name; });
      const bool kept = one.outcome == TriedGroup::Outcome::kept;
      if (known == tried.end())
        tried.push_back(one);
      else if (kept != (known->outcome == TriedGroup::Outcome::kept) ? kept
                                                                     : one.gain > known->gain)
        *known = one;
    }
  }
  void set_lost(const std::string& name) {
    for (TriedGroup& t : tried)
      if (t.name == name) t.outcome = TriedGroup::Outcome::lost;
  }
  void add_stage(const Model& model, const Calibrated& before) {
    stages.push_back(
        {model.options.begin.further, std::make_shared<const Solution>(before.found.solution)});
  }
};

/// Calibrates a model if all these groups keep their evidence; else they become those that do, and
/// nothing is returned.
std::optional<Calibrated> calibrate_with(std::vector<std::string>& groups, const Model& model) {
  const size_t before = groups.size();
  const auto learned = learn_model(model);
  groups.erase(
      std::remove_if(groups.begin(), groups.end(),
                     [&](const std::string& name) { return !has_evidence(*learned, name); }),
      groups.end());
  if (groups.size() < before) return {};
  Calibrated out = calibrate_groups(*learned, model.options);
  if (out.found.solution.usable()) return out;
  groups.clear();
  return {};
}

/// Tries groups of bending, each on top of those before.
void bend_joints(const std::vector<std::string>& names, Model& model, Calibrated& best,
                 FurtherRecord& record) {
  const std::vector<std::string> tried = best.fit.groups.further;
  const auto& kept = model.options.begin.further;
  for (const std::string& name : names) {
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
      record.add(found.tried);
      if (found.groups.empty() || found.gain <= trial.gain) continue;
      trial = std::move(found);
      next = std::move(one);
    }
    if (trial.groups.empty()) continue;
    next = grown(std::move(next), trial, best);
    std::vector<std::string> groups = trial.groups;
    std::optional<Calibrated> found = calibrate_with(groups, next);
    if (!found) {
      for (const std::string& g : trial.groups) record.set_lost(g);
      continue;
    }
    record.add_stage(model, best);
    model = std::move(next);
    best = std::move(*found);
  }
}

using AddsGroups = std::function<Model(const std::vector<std::string>&)>;

/// Calibrates with the groups of a trial, again without those that lose their evidence.
void keep(FurtherTrial trial, const AddsGroups& with, Model& model, Calibrated& best,
          FurtherRecord& record) {
  record.add(trial.tried);
  while (!trial.groups.empty()) {
    Model next = grown(with(trial.groups), trial, best);
    std::vector<std::string> groups = trial.groups;
    std::optional<Calibrated> found = calibrate_with(groups, next);
    if (!found) {
      for (const std::string& g : trial.groups)
        if (!is_among(groups, g)) record.set_lost(g);
      trial.groups = std::move(groups);
      continue;
    }
    record.add_stage(model, best);
    model = std::move(next);
    best = std::move(*found);
    return;
  }
}

/// Tries groups together, each on top of those with more evidence, and keeps those that help.
/// `with` adds the models of groups; `chosen` is the ripple that was found, if it is one, and how
/// unlikely what is tried was beforehand.
void add_together(const std::vector<std::string>& names, const AddsGroups& with, Model& model,
                  Calibrated& best, FurtherRecord& record, const FoundRipple& chosen = {}) {
  if (names.empty()) return;
  FurtherModel further = further_model(with(names), best.fit);
  further.log_candidates = chosen.log_candidates;
  further.left = chosen.left;
  keep(try_model(best.fit, further, *best.found.solution.recording), with, model, best, record);
}

/// Groups of conditions, and what adds their parameters. (Points have theirs.)
const std::pair<const char*, std::shared_ptr<const Recording> (*)(const Recording&)> kConditions[] =
    {{kPrints, with_prints},
     {kWarps, with_warps},
     {kMarkers, make_recording},
     {kBacklash, with_backlash},
     {kTimeOffsets, with_time_offsets},
     {kTemperature, with_temperature}};

/// The shapes of targets, backlash, time offsets and temperature. Each may hide another: one that
/// was not kept is tried again beside those that were.
void add_conditions(Model& model, Calibrated& best, FurtherRecord& record) {
  const std::vector<std::string> possible = best.fit.groups.further;
  const auto with = [&](const std::vector<std::string>& groups) {
    Model out = model;
    for (const auto& [name, add] : kConditions)
      if (is_among(groups, name)) out.recording = add(*out.recording);
    for (const std::string& name : groups) out.options.begin.further.push_back(name);
    return out;
  };
  model.options.progress.stage("shapes of targets, backlash, time offsets, temperature");
  const std::vector<std::string>& kept = model.options.begin.further;
  for (size_t before = kept.size() + 1; before != kept.size();) {
    before = kept.size();
    std::vector<std::string> names;
    for (const auto& condition : kConditions)
      if (is_among(possible, condition.first) && !is_among(kept, condition.first))
        names.emplace_back(condition.first);
    add_together(names, with, model, best, record);
  }
}

using AddsToJoints = std::shared_ptr<const Recording> (*)(const Recording&,
                                                          const std::vector<int>&);

/// Groups of single joints of one kind, which `make` adds. Returns whether one was kept.
bool add_to_joints(const std::string& kind, AddsToJoints make, Model& model, Calibrated& best,
                   FurtherRecord& record) {
  const auto joint_of = [&](const std::string& name) {
    return model.recording->rig.tree.find_joint(name.substr(kind.size()));
  };
  std::vector<std::string> names;
  for (const std::string& name : best.fit.groups.further)
    if (is_of(kind, name) && !is_among(model.options.begin.further, name) &&
        (kind != kRippleOf ||  // (others are searched for)
         !model.recording->rig.joints[joint_of(name)].terms.gear_ratios.empty()))
      names.push_back(name);
  model.options.progress.stage(kind + "JOINT");
  const auto with = [&](const std::vector<std::string>& groups) {
    std::vector<int> joints;
    for (const std::string& name : groups) joints.push_back(joint_of(name));
    Model out = model;
    out.recording = make(*model.recording, joints);
    return out;
  };
  const size_t before = model.options.begin.further.size();
  add_together(names, with, model, best, record);
  return model.options.begin.further.size() > before;
}

/// Looks for ripples with ratios that the rig does not state, one after the other.
void search_ripples(Model& model, Calibrated& best, FurtherRecord& record) {
  model.options.progress.stage("ripples");
  const std::vector<std::string>& kept = model.options.begin.further;
  for (size_t before = kept.size() + 1; before != kept.size();) {
    before = kept.size();
    const std::optional<FoundRipple> found = find_ripple(joint_errors(best.fit));
    if (!found) return;
    const auto with = [&](const std::vector<std::string>&) {
      Model out = model;
      Rig rig = model.recording->rig;
      JointTerms& terms = rig.joints[found->joint].terms;
      terms.gear_ratios = {static_cast<double>(found->cycles)};
      terms.ratios_found = true;
      out.recording = with_ripple(model.recording->with_rig(std::move(rig)), {found->joint});
      return out;
    };
    add_together({kRippleOf + model.recording->rig.tree.joints[found->joint].name}, with, model,
                 best, record, *found);
  }
}

/// Log odds that the gears of a robot are as stated: one robot of a hundred has another. (Of 280
/// right recordings none was given gears.)
const double kGearsRight = std::log(100);

/// Weighs gears with unknown noise: an error that grows with the angle looks like noise of a joint,
/// and a fit without gears has it there.
FurtherTrial try_gears_in_noise(const Calibrated& best) {
  FurtherTrial out;
  TriedGroup tried{kGears};
  tried.gain = -kInfinity;
  std::vector<std::vector<FreeDirection>> gears;
  for (const double factor : kWidthsTried) {
    gears.emplace_back();
    for (const Member& m : best.fit.groups.gears)
      gears.back().push_back({{{m.component, 1}}, factor * m.start});
  }
  const std::vector<double> score = scores(linearise(best.found.solution), gears);
  for (size_t i = 0; i < score.size(); ++i) {
    const double u = std::log(kWidthsTried[i]) / kWidthSpread,
                 gain = score[i] - kGearsRight - u * u / 2;
    if (!(gain > tried.gain)) continue;
    tried.gain = gain;
    out.factor[kGears] = kWidthsTried[i];
  }
  if (tried.gain >= kEvidence) {
    tried.outcome = TriedGroup::Outcome::kept;
    out.groups = {kGears};
  }
  out.tried = {std::move(tried)};
  return out;
}

/// Whether the noise of a joint's readings is what a fit shows, and not what the rig states: else
/// nothing hides in it, and weighing gears with unknown noise would only take time.
bool has_seen_noise(const Calibrated& best) {
  const std::vector<JointSettings>&now = best.fit.recording->rig.joints,
        &stated = best.found.solution.rig().joints;
  for (size_t j = 0; j < now.size(); ++j)
    if (now[j].noise_guess > 0 || now[j].sigma > stated[j].sigma) return true;
  return false;
}

/// Tries gears of other ratios: the last, for what bends or ripples goes with the angle as well.
void add_gears(Model& model, Calibrated& best, FurtherRecord& record) {
  const auto is_open = [&] {
    return is_among(best.fit.groups.further, kGears) &&
           !is_among(model.options.begin.further, kGears);
  };
  if (!is_open()) return;
  model.options.progress.stage(kGears);
  const AddsGroups with = [&](const std::vector<std::string>& groups) {
    Model out = model;
    out.options.begin.further.insert(out.options.begin.further.end(), groups.begin(), groups.end());
    return out;
  };
  FoundRipple rare;  // as if it were chosen from a hundred groups, ninety-nine of them right
  rare.log_candidates = kGearsRight;
  add_together({kGears}, with, model, best, record, rare);
  if (is_open() && has_seen_noise(best)) keep(try_gears_in_noise(best), with, model, best, record);
}

/// Weighs other lenses of cameras, and adds their change of the other parameters to the prediction.
void weigh_lenses(Calibrated& best) {
  Prediction& prediction = *best.found.solution.prediction;
  for (OtherLens& lens : other_lenses(best.fit, best.found.solution.columns)) {
    VectorXd moved = VectorXd::Zero(prediction.covariance.rows());
    for (size_t i = 0; i < lens.columns.size(); ++i) {
      const auto found =
          std::find(prediction.columns.begin(), prediction.columns.end(), lens.columns[i]);
      if (found != prediction.columns.end())
        moved(found - prediction.columns.begin()) = lens.moved(static_cast<Eigen::Index>(i));
    }
    cover_change(moved, lens.model.probability(), prediction.covariance);
    best.found.other_models.push_back(std::move(lens.model));
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
  const auto learned = learn_model(model);
  model.mounts = mounts_of(learned);
  Calibrated best = calibrate_groups(*learned, options);
  const std::vector<std::string>& kept = options.begin.further;
  if (best.found.solution.usable() && std::any_of(kept.begin(), kept.end(), [&](const auto& name) {
        return !is_kept(best.found, name);
      })) {  // lost its evidence, with other noise or samples: what stood behind it is tried again
    AutomaticOptions anew = options;
    anew.begin = {};
    anew.begin.noise_factor = options.begin.noise_factor;
    return calibrate_automatically(*without_added(given), anew);
  }
  if (best.found.solution.usable() && best.fit.recording) {  // (else no widths were learned)
    FurtherRecord record;
    do {
      add_conditions(model, best,
                     record);  // (nothing else looks like a shape, or what a sample states)
      bend_joints({kCompliance, kComplianceAcross}, model, best, record);
      add_to_joints(kRippleOf, with_ripple, model, best, record);
      add_to_joints(kCurve, with_curves, model, best, record);
      // (After the curves: beside compliances they lie in a curved valley, where each fit is slow.)
      bend_joints({kLoads}, model, best, record);
      search_ripples(model, best, record);
    } while (
        add_to_joints(kCouplingOf, with_coupling, model, best, record));  // (it hid the others)
    add_gears(model, best, record);
    if (best.found.solution.prediction) {
      weigh_lenses(best);
      best.found.pose_errors = add_pose_errors(best.found.solution);
      set_predicted_sigmas(best.found);
    }
    best.found.tried = std::move(record.tried);
    best.found.stages = std::move(record.stages);
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
