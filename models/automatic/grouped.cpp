#include "grouped.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <stdexcept>
#include <utility>

#include "../fitting/fit.h"
#include "gauge_errors.h"
#include "guessed_noise.h"
#include "other_robot.h"

namespace kincal {
namespace {

const char* const kMounts = "mounts";
const char* const kEverything = "everything";
constexpr int kLinearisations = 4, kWidthRounds = 60, kNoiseRounds = 30;
constexpr int kFitIterations = 6;  // between two estimates of noise that is not at rest
constexpr double kSettled =
    0.1;  // change of a width, relative, that asks for no linearisation anew

void take_away(const std::vector<Freed>& away, std::vector<Freed>& from) {
  for (const Freed& a : away)
    for (Freed& f : from)
      if (f.parameter == a.parameter)
        f.components.erase(
            std::remove_if(
                f.components.begin(), f.components.end(),
                [&](int c) { return std::count(a.components.begin(), a.components.end(), c) > 0; }),
            f.components.end());
  from.erase(
      std::remove_if(from.begin(), from.end(), [](const Freed& f) { return f.components.empty(); }),
      from.end());
}

bool is_among(const std::vector<Freed>& all, const Component& c) {
  const Freed* f = find_freed(all, c.parameter);
  return f && std::count(f->components.begin(), f->components.end(), c.index);
}

void name(const ParameterTable& table, const std::vector<Freed>& freed,
          std::vector<std::string>& out) {
  for (const Freed& f : freed) {
    const Parameter& p = table.all[f.parameter];
    if (f.whole(p))
      out.push_back(p.name);
    else
      for (int c : f.components) out.push_back(p.component_name(c));
  }
}

/// Poses of mounted targets that only held-out samples see: named, so that they are estimated when
/// these are judged.
std::vector<std::string> held_out_poses(const Recording& recording) {
  std::vector<char> seen(recording.rig.targets.size(), 0), seen_held_out = seen;
  for (const Sample& s : recording.samples)
    for (const View& v : s.views) (s.train ? seen : seen_held_out)[v.target] = 1;
  std::vector<std::string> out;
  for (size_t t = 0; t < seen.size(); ++t)
    if (seen_held_out[t] && !seen[t] && recording.table.target_pose[t] >= 0 &&
        recording.rig.targets[t].mount_joint < 0)
      out.push_back(recording.table.all[recording.table.target_pose[t]].name);
  return out;
}

}  // namespace

AutomaticGroups groups_of(const Recording& recording, const AutomaticOptions& options,
                          const std::vector<std::string>& further) {
  AutomaticGroups out = make_groups(recording, options.groups);
  std::vector<Freed> fixed;
  for (size_t i = 0; i < options.fix.size(); ++i)
    merge(fixed, recording.table.find(options.fix[i], "fix[" + std::to_string(i) + "]"));
  take_away(fixed, out.mounts);
  const auto drop = [&](std::vector<Member>& members) {
    members.erase(std::remove_if(members.begin(), members.end(),
                                 [&](const Member& m) { return is_among(fixed, m.component); }),
                  members.end());
  };
  drop(out.stated);
  const auto is_among_further = [&](const std::string& name) {
    return std::count(further.begin(), further.end(), name) > 0;
  };
  if (!out.gears.empty()) {
    if (is_among_further(kGears))
      out.groups.push_back({kGears, std::exchange(out.gears, {}), {}});
    else
      out.further.emplace_back(kGears);
  }
  const bool added = recording.rig.elasticity && recording.rig.elasticity->added;
  for (WidthGroup& g : out.groups) {
    drop(g.members);
    drop(g.unseen);
    if (!(added && is_bending(g.name)) && g.name != kMarkers) continue;
    if (is_among_further(g.name)) continue;
    out.further.push_back(g.name);
    g = WidthGroup();
  }
  out.groups.erase(
      std::remove_if(out.groups.begin(), out.groups.end(),
                     [](const WidthGroup& g) { return g.members.empty() && g.unseen.empty(); }),
      out.groups.end());
  // Only products of loads and compliances count: with both, the widths of compliances are those
  // that they had without.
  if (std::any_of(out.groups.begin(), out.groups.end(),
                  [](const WidthGroup& g) { return g.name == kLoads; }))
    for (WidthGroup& g : out.groups) g.width_known = g.width_known || is_bending(g.name);
  return out;
}

std::vector<Step> steps_of(const Recording& recording, const AutomaticGroups& groups,
                           const VectorXd& factor, const std::vector<Component>& held) {
  const ParameterTable& table = recording.table;
  const std::vector<std::string> held_out = held_out_poses(recording);
  Step mounts, everything;
  mounts.name = kMounts;
  everything.name = kEverything;
  mounts.sensors = everything.sensors = indices(recording.rig.sensors.size());
  std::vector<Freed> turning = groups.mounts, placed;
  take_away(groups.pointing, turning);
  // (The whole pose of a point is put where the data have it; one held in part is searched for.)
  for (const Freed& pose : groups.mounts)
    if (pose.whole(table.all[pose.parameter]))
      placed.push_back(pose);
    else if (const Freed* rest = find_freed(turning, pose.parameter))
      placed.push_back(*rest);
  name(table, placed, mounts.free);
  name(table, turning, everything.free);
  for (size_t g = 0; g < groups.groups.size(); ++g)
    for (const Member& m : groups.groups[g].members) {
      if (std::count(held.begin(), held.end(), m.component)) continue;
      PriorSetting prior;
      prior.pattern = table.name(m.component);
      prior.where = "group " + groups.groups[g].name;
      prior.translation = prior.rotation = factor(static_cast<Eigen::Index>(g)) * m.start;
      everything.free.push_back(prior.pattern);
      everything.priors.push_back(prior);
    }
  for (const Member& m : groups.stated) {
    PriorSetting prior;
    prior.pattern = table.name(m.component);
    prior.where = "priors";
    prior.translation = prior.rotation = m.start;
    if (!is_among(groups.mounts, m.component)) everything.free.push_back(prior.pattern);
    if (!is_among(groups.pointing, m.component)) everything.priors.push_back(prior);
  }
  for (Step* step : {&mounts, &everything})
    step->free.insert(step->free.end(), held_out.begin(), held_out.end());
  std::vector<Step> out;
  if (!groups.mounts.empty()) out.push_back(mounts);
  if (!everything.free.empty()) out.push_back(everything);
  return out;
}

VectorXd start_factors(const AutomaticGroups& groups) {
  return VectorXd::Ones(static_cast<Eigen::Index>(groups.groups.size()));
}

namespace {

/// Moves what is held back to where it counts from: a pose of which nothing is estimated any more
/// to the last bit.
void put_back(const ParameterTable& table, const VectorXd& initial,
              const std::vector<Component>& columns, const std::vector<char>& held,
              VectorXd& shared) {
  struct PoseColumns {
    std::vector<int> held;
    bool estimated = false;  // some other component is
  };
  std::map<int, PoseColumns> poses;
  for (size_t i = 0; i < columns.size(); ++i) {
    const Component& c = columns[i];
    const Parameter& p = table.all[c.parameter];
    if (!p.pose) {
      if (held[i]) shared(p.start + c.index) = initial(p.start + c.index);
    } else if (held[i]) {
      poses[c.parameter].held.push_back(c.index);
    } else {
      poses[c.parameter].estimated = true;
    }
  }
  for (const auto& entry : poses) {
    if (entry.second.held.empty()) continue;
    const int start = table.all[entry.first].start;
    const Pose from = get_pose(initial, start);
    Vector6d xi = log_se3(inverse(from) * get_pose(shared, start));
    for (int c : entry.second.held) xi(c) = 0;
    set_pose(shared, start, entry.second.estimated ? from * exp_se3(xi) : from);
  }
}

/// What rounds of fits and widths found.
struct Learned {
  Outcome outcome = Outcome::converged;
  Values values;
  std::vector<Component> columns;
  WidthProblem problem;
  Widths widths;
  std::vector<UncheckedScale> unchecked;
  EstimationSetup setup;                       // of the last fit
  std::shared_ptr<const Recording> recording;  // with the noise that was found
  double noise_factor = 1;
  bool at_rest = false;
  DataProblem data;  // at the last fit, of that recording
};

/// Which lengths nothing checks, as boards' squares and gears say, at a fit without these.
void judge_scales(const Recording& recording, const Fit& fit, const AutomaticGroups& groups,
                  Learned& out) {
  FitWidths with{out.problem, out.columns};
  VectorXd factor = out.widths.factor;
  if (!groups.gears.empty()) {
    AutomaticGroups all = groups;
    all.groups.push_back({kGears, groups.gears, {}});
    with = width_problem(recording, data_problem(recording, fit.problem->setup(), fit.values, all),
                         all);
    factor.conservativeResize(factor.size() + 1);
    factor(factor.size() - 1) = 1;
  }
  VectorXd sigma = VectorXd::Zero(with.problem.at.size());
  for (Eigen::Index i = 0; i < sigma.size(); ++i) {
    const auto found = std::find(out.columns.begin(), out.columns.end(), with.columns[i]);
    if (found != out.columns.end())
      sigma(i) = std::sqrt(out.widths.posterior.variance(found - out.columns.begin()));
  }
  out.unchecked = unchecked_scales(recording, with, factor, sigma, out.values.shared);
}

/// Where learning begins, and what is counted from.
struct Start {
  Values values;
  VectorXd initial;
};

FitOptions fit_options_of(const AutomaticOptions& options, const char* stage) {
  FitOptions out;
  out.trust_start = true;
  out.solver.threads = options.threads;
  out.solver.linear_solver = options.linear_solver;
  out.solver.relative_decrease = 1e-7;
  out.solver.second_derivatives = false;  // residuals are as large as their noise
  out.solver.progress = options.progress.in(stage);
  return out;
}

Learned learn(const Recording& given, const StepPlan& plan, const AutomaticGroups& groups,
              VectorXd factor, const AutomaticOptions& options, const Start& from) {
  Learned out;
  out.recording = make_recording(given);
  out.values = from.values;
  EstimationSetup setup;
  setup.noise = options.noise;
  setup.sensors = plan.sensors;
  setup.free = plan.free;
  setup.initial = from.initial;
  const auto members = starting_widths(groups);
  FitOptions fit_options = fit_options_of(options, "widths");
  bool settled = false;
  FixedPoint steps = noise_steps();
  const bool scaled = options.noise_is == StatedNoise::scaled;
  if (scaled) out.noise_factor = options.begin.noise_factor;
  for (int pass = 0;; ++pass) {
    const Recording& recording = *out.recording;
    options.progress.stage("widths, round " + std::to_string(pass + 1));
    setup.priors = plan.priors;
    for (Prior& prior : setup.priors) {
      const auto found = members.find({prior.parameter, prior.component});
      if (found != members.end() && found->second.first >= 0)
        prior.sigma = factor(found->second.first) * found->second.second;
    }
    Fit done = fit(recording, recording.training(), setup, out.values, fit_options);
    out.outcome = done.summary.outcome;
    if (!done.defined()) return out;
    out.values = done.values;
    const DataProblem data = data_problem(recording, done.problem->setup(), done.values, groups);
    FitWidths found = width_problem(recording, data, groups);
    out.columns = std::move(found.columns);
    out.problem = std::move(found.problem);
    out.widths = learn_widths(out.problem, factor, kWidthRounds);
    if (!out.widths.defined) return out;
    const double change =
        factor.size() ? (out.widths.factor.array() / factor.array()).log().abs().maxCoeff() : 0;
    factor = out.widths.factor;
    settled = settled || change < kSettled || pass + 1 == kLinearisations;
    if (!settled) continue;  // (what is far off would be taken for noise)
    fit_options.solver.near_minimum = true;
    fit_options.solver.max_iterations =
        out.at_rest ? SolverOptions().max_iterations : kFitIterations;
    NoisyRecording next{out.recording, {}};
    if (scaled) next.doubted.factor = out.noise_factor;
    if (options.noise_is == StatedNoise::wrong) next.doubted.stated = &given.rig;
    const double moved = move_noise(data, out.problem, factor, steps, next);
    out.at_rest = moved < 1;
    const bool ends = moved == 0 || (out.at_rest && out.outcome != Outcome::not_converged);
    if (ends || pass + 1 >= kNoiseRounds) {
      judge_scales(recording, done, groups, out);
      out.setup = done.problem->setup();
      out.data = data;
      return out;
    }
    out.recording = std::move(next.recording);
    out.noise_factor = next.doubted.factor.value_or(1);
  }
}

/// The predicted error of a member that no measurement depends on: `place` in groups and in the
/// unseen ones of its group.
double unseen_sigma(const AutomaticGroups& groups, const Learned& learned,
                    const Selection& selection, const std::vector<OtherRobot>& others,
                    const std::pair<size_t, size_t>& place) {
  const auto& [g, i] = place;
  const auto k = static_cast<Eigen::Index>(g);
  const WidthGroup& group = groups.groups[g];
  double out = learned.widths.factor(k) * group.unseen[i].start * std::sqrt(selection.inflation(k));
  for (const OtherRobot& other : others)
    if (other.group == static_cast<int>(g)) out = other.mixed(group.members.size() + i, out);
  return out;
}

/// The largest width of a group's members over its starting width.
double widest(const WidthGroup& group, int g, double factor,
              const std::vector<OtherRobot>& others) {
  double out = factor;
  for (const OtherRobot& other : others)
    for (size_t k = 0; other.group == g && k < other.width.size(); ++k) {
      const size_t seen = group.members.size();
      const double start = (k < seen ? group.members[k] : group.unseen[k - seen]).start;
      out = std::max(out, other.mixed(k, factor * start) / start);
    }
  return out;
}

/// What errors are predicted from: all that was estimated or held, and what no measurement sees.
Prediction prediction_of(const AutomaticGroups& groups, const Learned& learned,
                         const Selection& selection, const std::vector<OtherRobot>& others) {
  Prediction out;
  out.columns = learned.columns;
  std::vector<double> sigma;
  for (size_t g = 0; g < groups.groups.size(); ++g)
    for (size_t i = 0; i < groups.groups[g].unseen.size(); ++i) {
      out.columns.push_back(groups.groups[g].unseen[i].component);
      sigma.push_back(unseen_sigma(groups, learned, selection, others, {g, i}));
    }
  const auto n = static_cast<Eigen::Index>(learned.columns.size()),
             all = static_cast<Eigen::Index>(out.columns.size());
  out.covariance.setZero(all, all);
  MatrixXd moment = selection.second_moment;
  for (const OtherRobot& other : others) moment = other.mixed(moment);
  out.covariance.topLeftCorner(n, n) = moment;
  for (Eigen::Index i = n; i < all; ++i) out.covariance(i, i) = sigma[i - n] * sigma[i - n];
  return out;
}

/// Only products of loads and compliances are found. Where both are estimated, one factor of all is
/// known by their widths alone, and moves nothing but where it is taken for more than first order:
/// errors are predicted with the largest load as it is. (A payload, whose mass is known, determines
/// it.)
void fix_factor_of_loads(const Recording& recording, const VectorXd& values, Prediction& out) {
  const ParameterTable& table = recording.table;
  if (std::any_of(recording.samples.begin(), recording.samples.end(),
                  [](const Sample& s) { return s.train && s.conditions.payload >= 0; }))
    return;
  Eigen::Index largest = -1;
  double most = 0;
  bool bends = false;
  for (size_t i = 0; i < out.columns.size(); ++i) {
    const Parameter& p = table.all[out.columns[i].parameter];
    bends = bends || p.kind == ParameterKind::compliance;
    const double load = std::abs(values(p.start + out.columns[i].index));
    if (p.kind != ParameterKind::load || load <= most) continue;
    most = load;
    largest = static_cast<Eigen::Index>(i);
  }
  if (largest < 0 || !bends || !(out.covariance(largest, largest) > 0)) return;
  const VectorXd with = out.covariance.col(largest);
  out.covariance -= with * with.transpose() / with(largest);
  out.covariance.row(largest).setZero();
  out.covariance.col(largest).setZero();
}

/// The data's equations at the solution, of all that was estimated or held: those that the widths
/// were learned from, moved there.
DataEquations data_of(const Learned& learned, const Solution& solution) {
  const auto n = static_cast<Eigen::Index>(learned.columns.size());
  VectorXd moved(n);
  for (Eigen::Index i = 0; i < n; ++i)
    moved(i) = value_of(solution.table(), learned.values.shared, solution.values.shared,
                        learned.columns[i]);
  return {learned.columns, learned.problem.normal,
          -learned.problem.gradient - learned.problem.normal * moved};
}

std::vector<AutomaticGroup> told(const AutomaticGroups& groups, const Learned& learned,
                                 const Selection& selection, const std::vector<OtherRobot>& others,
                                 const Solution& solution) {
  const ParameterTable& table = solution.table();
  std::vector<AutomaticGroup> out;
  for (size_t g = 0; g < groups.groups.size(); ++g) {
    const auto k = static_cast<Eigen::Index>(g);
    AutomaticGroup one;
    one.name = groups.groups[g].name;
    one.factor = learned.widths.factor(k);
    one.widest = widest(groups.groups[g], static_cast<int>(g), one.factor, others);
    one.gamma = learned.widths.gamma(k);
    one.gain = selection.gain(k);
    one.held = selection.whole[g];
    for (size_t i = 0; i < learned.columns.size(); ++i) {
      if (learned.problem.group[i] != static_cast<int>(g)) continue;
      const auto c = static_cast<Eigen::Index>(i);
      AutomaticNumber number;
      number.name = table.name(learned.columns[i]);
      number.unit = table.unit(learned.columns[i]);
      number.width = one.factor * learned.problem.start(c);
      number.told = 1 - learned.widths.posterior.variance(c) / (number.width * number.width);
      number.held =
          selection.held[i] && !std::count(solution.columns.begin(), solution.columns.end(),
                                           learned.columns[i]);  // `free` names it
      one.held = one.held && (number.held || !selection.held[i]);
      number.value = number.held ? 0
                                 : value_of(table, solution.initial, solution.values.shared,
                                            learned.columns[i]);
      number.sigma = std::sqrt(solution.prediction->covariance(c, c));
      one.numbers.push_back(number);
    }
    for (size_t i = 0; i < groups.groups[g].unseen.size(); ++i) {
      const Member& m = groups.groups[g].unseen[i];
      one.unseen.push_back({table.name(m.component), table.unit(m.component), 0,
                            unseen_sigma(groups, learned, selection, others, {g, i}),
                            one.factor * m.start, 0, true});
    }
    out.push_back(std::move(one));
  }
  return out;
}

/// Turns poses about their pivots back to the rig's rotation (`initial`).
void turn_to_initial(const ParameterTable& table, const std::map<int, Vector3d>& pivots,
                     const VectorXd& initial, VectorXd& shared) {
  for (const auto& [parameter, pivot] : pivots) {
    const int start = table.all[parameter].start;
    Pose pose = get_pose(shared, start);
    const Matrix3d given = get_pose(initial, start).rotation;
    pose.translation += (pose.rotation - given) * pivot;
    pose.rotation = given;
    set_pose(shared, start, pose);
  }
}

/// Gauges of the mounts: one component of each is fixed, where the rig gives its pose as given.
std::vector<Gauge> fix_gauges(const Recording& recording, const VectorXd& initial,
                              AutomaticGroups& groups, VectorXd& shared) {
  std::vector<Freed> poses = groups.mounts, stated;
  take_away(groups.pointing, poses);
  for (const Member& m : groups.stated)
    merge(stated, {{m.component.parameter, {m.component.index}}});
  take_away(stated, poses);
  std::vector<Gauge> out = find_gauges(recording, shared, poses);
  std::vector<Component> columns;
  std::vector<char> fixed;
  for (const Freed& pose : poses)
    for (const int c : pose.components) {
      columns.push_back({pose.parameter, c});
      fixed.push_back(std::any_of(out.begin(), out.end(), [&](const Gauge& g) {
        return g.given && g.fixed == columns.back();
      }));
    }
  for (const Gauge& g : out) merge(groups.pointing, {{g.fixed.parameter, {g.fixed.index}}});
  put_back(recording.table, initial, columns, fixed, shared);
  return out;
}

/// The options of a calibration with such steps: what `fix` names is in none of them.
CalibrationOptions plain(const AutomaticOptions& options) {
  CalibrationOptions out = options;
  out.fix.clear();
  return out;
}

}  // namespace

void set_predicted_sigmas(AutomaticCalibration& found) {
  Solution& solution = found.solution;
  const Prediction& p = *solution.prediction;
  for (size_t i = 0; i < p.columns.size(); ++i) {
    const auto k = static_cast<Eigen::Index>(i);
    const double sigma = std::sqrt(p.covariance(k, k));
    for (ParameterEstimate& e : solution.parameters)
      if (e.parameter == p.columns[i].parameter && e.freed[p.columns[i].index] &&
          e.sigma[p.columns[i].index] > 0)
        e.sigma[p.columns[i].index] = sigma;
    const std::string name = solution.table().name(p.columns[i]);
    for (AutomaticGroup& group : found.groups)
      for (AutomaticNumber& number : group.numbers)
        if (number.name == name) number.sigma = sigma;
  }
}

namespace {

/// The solution with the mounts alone: of a calibration before, or estimated.
Solution mounts_alone(const Model& model, const std::shared_ptr<const Recording>& steps,
                      const AutomaticGroups& groups, const CalibrationOptions& run) {
  Solution out;
  out.recording = steps;
  if (model.mounts) {
    const Solution& before = *model.mounts;
    out.initial = shared_in(before.initial, before.table(), steps->table);
    out.values = before.values;
    out.values.shared = shared_in(before.values.shared, before.table(), steps->table);
    out.replaced_starts = before.replaced_starts;
  } else if (groups.mounts.empty()) {
    out.initial = out.values.shared = steps->table.initial;
  } else {
    CalibrationOptions mounts = run;
    mounts.last_step = kMounts;
    mounts.free.clear();
    out = uncancelled(calibrate(steps, mounts));
  }
  return out;
}

}  // namespace

struct LearnedModel {
  std::shared_ptr<const Recording> recording;  // with the noise that is guessed
  AutomaticGroups groups;
  Solution mounts;  // with these alone
  std::vector<Gauge> gauges;
  bool starts = false;  // there is a step for everything, and the mounts have a start
  bool defined = false;
  Learned learned;
  Selection selection;
  bool all_kept = false;  // whatever has evidence: options name what is estimated

  std::shared_ptr<const Recording> at_start() const {
    return with_steps(*recording, steps_of(*recording, groups, start_factors(groups), {}));
  }
};

std::shared_ptr<const LearnedModel> learn_model(const Model& model) {
  auto out = std::make_shared<LearnedModel>();
  const AutomaticOptions& options = model.options;
  out->recording = with_guessed_noise(*model.recording, options.noise);
  const Recording& recording = *out->recording;
  const Begin& begin = options.begin;
  AutomaticGroups& groups = out->groups = groups_of(recording, options, begin.further);
  if (steps_of(recording, groups, start_factors(groups), {}).empty())
    throw std::invalid_argument(
        nothing_free(recording, !options.fix.empty() || !options.groups.without.empty(), false));
  const CalibrationOptions run = plain(options);
  Solution& mounts = out->mounts = mounts_alone(model, out->at_start(), groups, run);
  if (!groups.mounts.empty()) {
    turn_to_initial(recording.table, groups.pivots, mounts.initial, mounts.values.shared);
    out->gauges = fix_gauges(recording, mounts.initial, groups, mounts.values.shared);
  }
  const StepPlan plan = resolve_steps(*out->at_start(), run).back();
  out->starts = plan.name == kEverything && mounts.status != Status::undefined_start;
  if (!out->starts) return out;
  VectorXd factor = start_factors(groups);
  for (size_t g = 0; g < groups.groups.size(); ++g)
    if (const auto found = begin.factor.find(groups.groups[g].name); found != begin.factor.end())
      factor(static_cast<Eigen::Index>(g)) = found->second;
  out->learned = learn(recording, plan, groups, factor, options,
                       {begin.start.value_or(mounts.values), mounts.initial});
  out->defined = out->learned.outcome != Outcome::undefined_start && out->learned.widths.defined;
  if (!out->defined) return out;
  options.progress.stage("selecting parameters by evidence");
  out->selection = hold(out->learned.problem, out->learned.widths);
  out->all_kept = !options.free.empty();
  return out;
}

bool has_evidence(const LearnedModel& model, const std::string& group) {
  const std::vector<WidthGroup>& groups = model.groups.groups;
  for (size_t g = 0; model.defined && g < groups.size(); ++g)
    if (groups[g].name == group) return model.all_kept || !model.selection.whole[g];
  return false;
}

std::shared_ptr<const Solution> mounts_of(const std::shared_ptr<const LearnedModel>& model) {
  return {model, &model->mounts};
}

Calibrated calibrate_groups(const LearnedModel& model, const AutomaticOptions& options) {
  AutomaticCalibration out;
  out.gauges = model.gauges;
  const Recording& recording = *model.recording;
  const AutomaticGroups& groups = model.groups;
  const CalibrationOptions run = plain(options);
  Solution& solution = out.solution;
  const Solution& mounts = model.mounts;
  if (!model.defined) {  // the calibration with starting widths says what is wrong
    solution = model.starts ? uncancelled(calibrate(model.at_start(), run)) : mounts;
    return {out, {}};
  }
  const Learned& learned = model.learned;
  const Selection& selection = model.selection;
  std::vector<Component> held;
  for (size_t i = 0; i < selection.held.size(); ++i)
    if (selection.held[i]) held.push_back(learned.columns[i]);
  const std::shared_ptr<const Recording> final =
      with_steps(*learned.recording, steps_of(recording, groups, learned.widths.factor, held));
  if (final->rig.steps.empty()) throw std::invalid_argument(nothing_free(recording, false, true));
  VectorXd start = learned.values.shared;
  put_back(recording.table, mounts.initial, learned.columns, selection.held, start);
  StepVariations variations;
  variations.start = mounts.values.shared;
  variations.before_step = [&](const StepPlan& step, const VectorXd&, VectorXd& shared) {
    if (step.name == kEverything) shared = start;
  };
  solution = uncancelled(calibrate(final, run, variations));
  if (solution.status == Status::unobservable) {
    // The noise of parameters that are fixed now determined what the data do not: how high a robot
    // with parallel axes stands. It led metres away. Poses stay at their start in such directions.
    start = mounts.values.shared;
    solution = uncancelled(calibrate(final, run, variations));
  }
  solution.replaced_starts = mounts.replaced_starts;
  if (!solution.usable() && solution.status != Status::not_converged) return {out, {}};
  const FitWidths at{learned.problem, learned.columns};
  const std::vector<OtherRobot> others =
      other_robots(*learned.recording, {groups, at, learned.widths, learned.setup, learned.values},
                   fit_options_of(options, "lengths of another robot"));
  solution.prediction = prediction_of(groups, learned, selection, others);
  fix_factor_of_loads(recording, solution.values.shared, *solution.prediction);
  out.other_models = other_models(recording, at, learned.widths, solution.initial);
  for (const OtherModel& other : out.other_models)
    if (other.moved.size() > 0)
      cover_change(other.moved, other.probability(), solution.prediction->covariance);
  add_gauges({learned.recording, learned.setup, solution.values, groups, learned.widths.factor},
             out.gauges, *solution.prediction);
  solution.data = data_of(learned, solution);
  out.groups = told(groups, learned, selection, others, solution);
  set_predicted_sigmas(out);
  out.mounts = mounts.values.shared;
  out.unchecked = learned.unchecked;
  out.noise_factor = learned.noise_factor;
  out.noise_at_rest = learned.at_rest;
  const bool larger = solution.chi2_per_dof() > 1;  // residuals than stated
  return {std::move(out),
          {larger ? with_seen_noise(learned.data, learned.problem, learned.widths.factor,
                                    learned.recording)
                  : learned.recording,
           learned.setup, learned.values, groups, learned.widths.factor}};
}

}  // namespace kincal
