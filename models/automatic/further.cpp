#include "further.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>
#include <utility>

#include "../../solver/decompositions.h"
#include "../joints/joint_models.h"
#include "../rig/elasticity.h"
#include "../rig/folds.h"
#include "../rig/targets.h"

namespace kincal {
namespace {

constexpr int kFurtherRounds = 20;  // of widths: changes are small by then
constexpr int kFolds = 5;           // as usual in cross-validation

/// Where the parameters of a recording are in one with more of them: by index.
std::vector<int> places_of(const ParameterTable& table, const ParameterTable& in) {
  std::vector<int> out;
  size_t next = 0;
  for (const Parameter& p : table.all) {
    while (in.all[next].name != p.name) ++next;
    out.push_back(static_cast<int>(next++));
  }
  return out;
}

bool all_zero(const std::vector<double>& values) {
  return std::all_of(values.begin(), values.end(), [](double v) { return v == 0; });
}

VectorXd moved(const VectorXd& shared, const ParameterTable& table, const ParameterTable& to,
               const std::vector<int>& places) {
  VectorXd out = to.initial;
  for (size_t p = 0; p < places.size(); ++p) {
    const Parameter& parameter = table.all[p];
    const int size = parameter.pose ? 12 : parameter.size();
    out.segment(to.all[places[p]].start, size) = shared.segment(parameter.start, size);
  }
  return out;
}

/// The fit in the parameters of the further model; behind its own groups gears, which may be the
/// reason as well, and the groups of that.
FitWithGroups moved(const FitWithGroups& fit, const FurtherModel& model) {
  const ParameterTable &from = fit.recording->table, &to = model.recording->table;
  const std::vector<int> places = places_of(from, to);
  FitWithGroups out = fit;
  out.recording = model.recording;
  for (Freed& f : out.setup.free) f.parameter = places[f.parameter];
  if (out.setup.initial.size() > 0) out.setup.initial = moved(fit.setup.initial, from, to, places);
  for (WidthGroup& group : out.groups.groups)
    for (std::vector<Member>* members : {&group.members, &group.unseen})
      for (Member& m : *members) m.component.parameter = places[m.component.parameter];
  for (std::vector<Member>* members : {&out.groups.stated, &out.groups.gears})
    for (Member& m : *members) m.component.parameter = places[m.component.parameter];
  std::vector<Member> gears = std::exchange(out.groups.gears, {});
  if (std::any_of(model.groups.begin(), model.groups.end(),
                  [](const WidthGroup& g) { return g.name == kGears; }))
    gears.clear();
  out.groups.groups.push_back({kGears, std::move(gears), {}});
  out.groups.groups.insert(out.groups.groups.end(), model.groups.begin(), model.groups.end());
  out.values = values_in(fit, *model.recording);
  out.factor.conservativeResizeLike(
      VectorXd::Ones(static_cast<Eigen::Index>(out.groups.groups.size())));
  return out;
}

/// By how many of its sigmas an unknown of the fit moves, at most, if a group has these values.
double largest_move(const WidthProblem& p, const Beside& of, const VectorXd& value) {
  const VectorXd by = solve_symmetric(of.h, p.normal(of.others, of.own) * value);
  const MatrixXd unit = MatrixXd::Identity(of.h.rows(), of.h.cols());
  const VectorXd variance = solve_symmetric(of.h, unit).diagonal();
  return std::sqrt((by.array().square() / variance.array()).maxCoeff());
}

/// The best widths of a problem of one group, from several starts.
Widths best_widths(const WidthProblem& problem) {
  Widths best;
  double most = 0;
  for (const double start : kWidthsTried) {
    if (!problem.learns(0) && start != 1) continue;
    Widths widths = learn_widths(problem, VectorXd::Constant(1, start), kFurtherRounds);
    if (!widths.defined) continue;
    const double u = std::log(widths.factor(0)) / std::log(3.0);
    const double evidence = log_evidence(problem, widths.factor) - u * u / 2;
    if (best.defined && !(evidence > most)) continue;
    best = std::move(widths);
    most = evidence;
  }
  return best;
}

/// What the samples of each fold say of a fit without them: twice their cost there, less that at
/// the present values. `unknowns` are estimated, with the priors that `precision` has; those that a
/// fold alone knows (the pose of a placement) are estimated from itself.
double held_out_cost(const WidthProblem& at, const std::vector<NormalPart>& folds,
                     const VectorXd& precision, const std::vector<int>& unknowns) {
  double out = 0;
  for (const NormalPart& fold : folds) {
    std::vector<int> known, own;
    for (const int i : unknowns)
      (precision(i) == 0 && at.normal(i, i) - fold.normal(i, i) <= 1e-9 * fold.normal(i, i) ? own
                                                                                            : known)
          .push_back(i);
    const VectorXd pull = precision.cwiseProduct(at.at);
    MatrixXd h = at.normal(known, known) - fold.normal(known, known);
    h.diagonal() += precision(known);
    const VectorXd b = at.gradient(known) - fold.gradient(known) + pull(known);
    const VectorXd step = -solve_symmetric(h, b);
    out += 2 * fold.gradient(known).dot(step) + step.dot(fold.normal(known, known) * step);
    if (own.empty()) continue;
    const VectorXd left = fold.gradient(own) + fold.normal(own, known) * step;
    out -= left.dot(VectorXd(solve_symmetric(fold.normal(own, own), left)));
  }
  return out;
}

/// Of groups that gain evidence (in this order) those that make samples of other blocks fit better,
/// each on top of those before.
std::vector<int> cross_validated(const WidthProblem& at, const std::vector<NormalPart>& folds,
                                 const VectorXd& factor, int first_further,
                                 const std::vector<int>& gaining) {
  VectorXd precision = VectorXd::Zero(at.start.size());
  std::vector<int> unknowns;
  for (int i = 0; i < precision.size(); ++i) {
    const double width = at.start(i) * (at.group[i] < 0 ? 1 : factor(at.group[i]));
    if (width > 0) precision(i) = 1 / (width * width);
    if (at.group[i] < first_further) unknowns.push_back(i);
  }
  std::vector<int> out;
  double least = held_out_cost(at, folds, precision, unknowns);
  for (const int group : gaining) {
    std::vector<int> more = unknowns;
    for (int i = 0; i < precision.size(); ++i)
      if (at.group[i] == group) more.push_back(i);
    const double cost = held_out_cost(at, folds, precision, more);
    if (!(cost < least)) continue;
    least = cost;
    unknowns = std::move(more);
    out.push_back(group);
  }
  return out;
}

}  // namespace

VectorXd shared_in(const VectorXd& shared, const ParameterTable& from, const ParameterTable& to) {
  return moved(shared, from, to, places_of(from, to));
}

Values values_in(const FitWithGroups& fit, const Recording& recording) {
  Values out = fit.values;
  out.shared = shared_in(fit.values.shared, fit.recording->table, recording.table);
  return out;
}

std::shared_ptr<const Recording> with_curves(const Recording& recording,
                                             const std::vector<int>& joints) {
  Rig rig = recording.rig;
  for (const int j : joints) rig.joints[j].model = find_joint_model(joint_models(), "curve");
  return make_recording(recording.with_rig(std::move(rig)));
}

std::shared_ptr<const Recording> with_backlash(const Recording& recording) {
  Rig rig = recording.rig;
  for (const int j : joints_with_backlash(rig, recording.samples)) rig.joints[j].terms.backlash = 0;
  return make_recording(recording.with_rig(std::move(rig)));
}

std::shared_ptr<const Recording> with_temperature(const Recording& recording) {
  Rig rig = recording.rig;
  for (size_t j = 0; j < rig.joints.size(); ++j)
    if (const Joint& joint = rig.tree.joints[j];
        joint.has_reading() && joint.first_axis < 0 && joint.axis_of_pose == PoseAxis::none)
      rig.joints[j].terms.temperature = 0;
  return make_recording(recording.with_rig(std::move(rig)));
}

std::shared_ptr<const Recording> with_prints(const Recording& recording) {
  Rig rig = recording.rig;
  for (Target& target : rig.targets)
    if (target.grid && !target.print) target.print.emplace(0, 0);
  return make_recording(recording.with_rig(std::move(rig)));
}

std::shared_ptr<const Recording> with_warps(const Recording& recording) {
  Rig rig = recording.rig;
  for (Target& target : rig.targets)
    if (target.grid && target.bulge.cols() == 0) target.bulge = warp_shapes(target.layout);
  return make_recording(recording.with_rig(std::move(rig)));
}

std::shared_ptr<const Recording> with_ripple(const Recording& recording,
                                             const std::vector<int>& joints) {
  Rig rig = recording.rig;
  for (const int j : joints)
    rig.joints[j].terms.ripple.assign(kRipple * rig.joints[j].terms.gear_ratios.size(), 0);
  return make_recording(recording.with_rig(std::move(rig)));
}

std::shared_ptr<const Recording> with_coupling(const Recording& recording,
                                               const std::vector<int>& joints) {
  Rig rig = recording.rig;
  for (const int j : joints) {
    JointTerms& terms = rig.joints[j].terms;
    terms.coupled_to = next_joints(rig, j);
    terms.coupling.assign(terms.coupled_to.size(), 0);
  }
  return make_recording(recording.with_rig(std::move(rig)));
}

std::shared_ptr<const Recording> with_time_offsets(const Recording& recording) {
  Rig rig = recording.rig;
  for (const int s : sensors_with_rates(rig, recording.samples)) rig.sensors[s].time_offset = 0;
  return make_recording(recording.with_rig(std::move(rig)));
}

std::shared_ptr<const Recording> with_elasticity(const Recording& recording, bool rotor) {
  Rig rig = recording.rig;
  if (!rig.elasticity) rig.elasticity = nominal_elasticity(rig);
  rig.elasticity->rotor = rotor;
  rig.elasticity->added = true;
  return make_recording(recording.with_rig(std::move(rig)));
}

Recording with_models_of(const Recording& recording, const Recording& other) {
  Rig rig = recording.rig;
  rig.elasticity = other.rig.elasticity;
  for (size_t j = 0; j < rig.joints.size(); ++j) {
    rig.joints[j].model = other.rig.joints[j].model;
    rig.joints[j].further = other.rig.joints[j].further;
    rig.joints[j].terms = other.rig.joints[j].terms;
  }
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    rig.sensors[s].time_offset = other.rig.sensors[s].time_offset;
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    rig.targets[t].print = other.rig.targets[t].print;
    rig.targets[t].bulge = other.rig.targets[t].bulge;
    rig.targets[t].warp = other.rig.targets[t].warp;
  }
  return recording.with_rig(std::move(rig));
}

std::shared_ptr<const Recording> without_added(const Recording& recording) {
  Rig rig = recording.rig;
  std::set<std::string> named;  // by the rig's priors
  for (const PriorSetting& prior : rig.priors)
    for (const Freed& f : recording.table.find(prior.pattern, prior.where))
      named.insert(recording.table.all[f.parameter].name);
  for (JointSettings& joint : rig.joints) {
    JointTerms& terms = joint.terms;
    const std::string prefix = "joint/" + rig.tree.joints[&joint - rig.joints.data()].name + "/";
    if (terms.backlash == 0 && !named.count(prefix + "backlash")) terms.backlash.reset();
    if (terms.temperature == 0 && !named.count(prefix + "temperature")) terms.temperature.reset();
    if (all_zero(terms.ripple)) {
      terms.ripple.clear();
      if (terms.ratios_found) terms.gear_ratios.clear();
      terms.ratios_found = false;
    }
    if (all_zero(terms.coupling)) {
      terms.coupled_to.clear();
      terms.coupling.clear();
    }
    if (joint.model->name() == "curve" && all_zero(joint.further)) {
      joint.model = linear_joint();
      joint.further.clear();
    }
  }
  for (Sensor& sensor : rig.sensors)
    if (sensor.time_offset == 0) sensor.time_offset.reset();
  for (Target& target : rig.targets) {
    const std::string prefix = "target/" + target.name + "/";
    const Eigen::Vector2d none(0, 0);
    if (target.print == none && !named.count(prefix + "print")) target.print.reset();
    if (target.warp == none && !named.count(prefix + "warp")) target.bulge.resize(2, 0);
  }
  if (rig.elasticity && (rig.elasticity->added || !bends(*rig.elasticity))) {
    const Elasticity nominal = nominal_elasticity(rig);
    rig.elasticity->added = false;
    if (rig.elasticity->gravity == nominal.gravity && rig.elasticity->load == nominal.load)
      rig.elasticity.reset();
  }
  return make_recording(recording.with_rig(std::move(rig)));
}

FurtherTrial try_model(const FitWithGroups& fit, const FurtherModel& model,
                       const Recording& folded) {
  FurtherTrial out;
  const FitWithGroups with = moved(fit, model);
  const DataProblem data = data_problem(*with.recording, with.setup, with.values, with.groups);
  WidthProblem at = width_problem(*with.recording, data, with.groups).problem;
  at.normal /= model.left;
  at.gradient /= model.left;
  const auto gears = static_cast<int>(fit.groups.groups.size()), first = gears + 1;
  VectorXd factor = with.factor;
  if (!with.groups.groups[gears].members.empty())
    if (const Widths learned = best_widths(alone(at, beside(at, factor, gears, gears)));
        learned.defined)
      factor(gears) = learned.factor(0);
  std::vector<std::pair<double, int>> gaining;
  std::map<int, VectorXd> value;
  for (int group = first; group < factor.size(); ++group) {
    const WidthProblem one = alone(at, beside(at, factor, first, group));
    const Widths learned = best_widths(one);
    out.tried.push_back({with.groups.groups[group].name});
    if (!learned.defined) continue;
    factor(group) = learned.factor(0);
    value[group] = learned.posterior.value;
    const double gain = evidence_gain(one, learned, 0) - model.log_candidates;
    out.tried.back().gain = gain;
    if (gain >= kEvidence) gaining.push_back({-gain, group});
  }
  if (gaining.empty()) return out;
  std::sort(gaining.begin(), gaining.end());
  std::vector<int> order;
  const auto set_outcome = [&](int group, TriedGroup::Outcome outcome) {
    out.tried[static_cast<size_t>(group - first)].outcome = outcome;
  };
  for (const auto& entry : gaining) {
    order.push_back(entry.second);
    set_outcome(entry.second, TriedGroup::Outcome::too_few_samples);
  }
  std::vector<NormalPart> parts;
  try {
    const Folds folds = deal_folds(folded.rig, folded.samples, kFolds);
    parts = normal_parts(data, folds.of, folds.count);
    for (NormalPart& part : parts) {
      part.normal /= model.left;
      part.gradient /= model.left;
    }
  } catch (const std::invalid_argument&) {  // fewer blocks than folds
    return out;
  }
  for (const int group : order) set_outcome(group, TriedGroup::Outcome::no_better_held_out);
  for (const int group : cross_validated(at, parts, factor, first, order)) {
    const std::string& name = with.groups.groups[group].name;
    set_outcome(group, TriedGroup::Outcome::kept);
    out.groups.push_back(name);
    out.factor[name] = factor(group);
    out.value[name] = value[group];
    out.moves[name] = largest_move(at, beside(at, factor, first, group), value[group]);
    for (const auto& entry : gaining)
      if (entry.second == group) out.gain -= entry.first;
  }
  return out;
}

}  // namespace kincal
