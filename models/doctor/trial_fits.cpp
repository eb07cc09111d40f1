#include "trial_fits.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <set>
#include <stdexcept>

#include "../calibration/plan.h"
#include "../fitting/fit.h"
#include "../fitting/starts.h"
#include "../rig/scales.h"
#include "../rig/selection.h"

namespace kincal {
namespace {

using Samples = std::vector<Sample>;

// ------------------------------------------------------------------------------------------------
// what is freed
/// Whether the rig has a lens for a camera, and no value of its distortion: `init` writes 0.
bool is_lens_open(const Sensor& sensor) {
  const ParameterBlock* lens = find_block(sensor, ParameterKind::distortion);
  return lens &&
         std::all_of(lens->values.begin(), lens->values.end(), [](double k) { return k == 0; });
}

/// The recording with usual steps, for a rig without any: nothing is taken as known.
Recording with_usual_steps(const Recording& recording) {
  Rig rig = recording.rig;
  Step step;
  step.name = "poses";
  for (size_t s = 0; s < rig.sensors.size(); ++s) step.sensors.push_back(static_cast<int>(s));
  if (std::any_of(rig.sensors.begin(), rig.sensors.end(),
                  [](const Sensor& s) { return s.mount_joint < 0; }))
    step.free.push_back("sensor/*/pose");
  if (std::any_of(rig.targets.begin(), rig.targets.end(),
                  [](const Target& t) { return t.link >= 0 && t.mount_joint < 0; }))
    step.free.push_back("target/*/pose");
  std::set<int> joints;  // mounts that are seen
  for (const Sample& sample : recording.samples)
    for (const View& v : sample.views)
      joints.insert({rig.sensors[v.sensor].mount_joint, rig.targets[v.target].mount_joint});
  for (const int j : joints)
    if (j >= 0) step.free.push_back("joint/" + rig.tree.joints[j].name + "/origin");
  rig.steps = {step};
  step.name = "lenses";  // (after the poses: from far off a lens takes their errors up)
  const ParameterTable& table = recording.table;
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    if (!is_lens_open(rig.sensors[s])) continue;
    const int lens = table.index_of(ParameterKind::distortion, static_cast<int>(s));
    step.free.push_back(table.all[lens].name);
    for (int c = 0; c < table.all[lens].size(); ++c) {
      const std::string name = table.all[lens].component_name(c);
      const double width = scales(table, {lens, c}, table.initial).width;
      step.priors.push_back({name, width, width, false, name});
    }
  }
  if (!step.priors.empty()) rig.steps.push_back(step);
  step.name = "offsets";
  step.free.push_back("joint/*/offset");
  const double off = scales(ParameterKind::joint_offset, "rad").usual;
  step.priors.push_back({"joint/*/offset", off, off, false, "joint/*/offset"});
  try {
    Rig more = rig;
    more.steps.push_back(step);
    const Recording both = recording.with_rig(std::move(more));
    check_steps(both);
    return both;
  } catch (const std::invalid_argument&) {  // no joint matters
    return recording.with_rig(std::move(rig));
  }
}

/// The recording with samples for which `changes` holds changed.
template <typename Changes, typename Change>
Recording with_changed(const Recording& recording, Changes changes, Change change) {
  const std::vector<Sample>& given = recording.samples;
  if (std::none_of(given.begin(), given.end(), changes)) return recording;
  std::vector<Sample> samples = given;
  for (Sample& sample : samples)
    if (changes(sample)) change(sample);
  return recording.with_samples(std::move(samples));
}

/// What specs free and how, in the terms of a table.
struct ResolvedSpecs {
  std::vector<std::vector<Freed>> free;    // by spec
  std::vector<std::vector<Prior>> priors;  // by spec
  std::vector<char> whole,
      prior;  // by parameter: some spec frees all of it, some spec has a prior on it
};

ResolvedSpecs resolve(const ParameterTable& table, const std::vector<FitSpec>& specs) {
  ResolvedSpecs out;
  out.free.resize(specs.size());
  out.priors.resize(specs.size());
  out.whole.assign(table.all.size(), 0);
  out.prior.assign(table.all.size(), 0);
  for (size_t i = 0; i < specs.size(); ++i) {
    for (const std::string& name : specs[i].free) merge(out.free[i], table.select(name));
    for (const Freed& f : out.free[i])
      out.whole[f.parameter] = out.whole[f.parameter] || f.whole(table.all[f.parameter]);
    for (const auto& p : specs[i].priors) {
      const std::vector<Freed> found = table.select(p.first);
      if (found.empty()) continue;  // a hypothesis took it away, as a lens without distortion does
      const Freed& f = found[0];
      out.prior[f.parameter] = 1;
      out.priors[i].push_back({f.parameter, f.components[0], p.second});
    }
  }
  return out;
}

// ------------------------------------------------------------------------------------------------
// where a fit starts
/// Sets `values` to where the first spec starts. Returns the shared values that priors and partly
/// freed poses count from.
VectorXd first_values(const Recording& recording, const ResolvedSpecs& resolved,
                      const TrialOptions& options, const TargetStarts& how, Values& values) {
  const ParameterTable& table = recording.table;
  if (options.start) {
    values = *options.start;
    return table.initial;
  }
  values.shared = table.initial;
  std::vector<int> unknown;
  for (const std::vector<int>* all : {&table.sensor_pose, &table.target_pose})
    for (const int p : *all)
      if (p >= 0 && resolved.whole[p] && !resolved.prior[p] &&
          (options.closed_form || !is_given(recording.rig, table.all[p])))
        unknown.push_back(p);
  std::vector<char> taken(table.all.size(), 0);
  for (const int p : unknown) taken[p] = 1;
  std::vector<OriginProxy> mounts;
  for (const std::vector<int>* all : {&table.sensor_mount, &table.target_mount})
    for (const int p : *all)
      if (options.closed_form && p >= 0 && table.all[p].kind == ParameterKind::joint_origin &&
          resolved.whole[p] && !resolved.prior[p] &&
          std::none_of(mounts.begin(), mounts.end(),
                       [&](const OriginProxy& m) { return m.origin == p; }))
        if (const auto found = find_origin_proxy(recording, p, taken)) mounts.push_back(*found);
  for (const OriginProxy& mount : mounts) {
    unknown.push_back(mount.body);
    unknown.insert(unknown.end(), mount.others.begin(), mount.others.end());
  }
  std::sort(unknown.begin(), unknown.end());
  unknown.erase(std::unique(unknown.begin(), unknown.end()), unknown.end());
  if (!unknown.empty())
    start_unknown_poses(recording, indices(recording.samples.size()), unknown, values, how);
  for (const OriginProxy& mount : mounts) move_origin(table, mount, table.initial, values.shared);
  return values.shared;
}

// ------------------------------------------------------------------------------------------------
// where it ends
/// Fills in degrees of freedom and what samples and sensors have; the problem is renewed at
/// `state`.
void collect_statistics(const Recording& recording, const Estimation& problem,
                        const VectorXd& state, TrialFit& out) {
  const Rig& rig = recording.rig;
  const size_t samples = recording.samples.size();
  out.sample.assign(samples, std::nan(""));
  std::vector<double> excess(samples, 1);  // rows minus private unknowns
  out.sensor.assign(rig.sensors.size(), std::nan(""));
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const GroupShape& shape = problem.groups()[g];
    out.dof += shape.rows - shape.private_size;
    Cost cost;
    const int sample = problem.sample_of(static_cast<int>(g));
    if (sample < 0 || !problem.evaluate(static_cast<int>(g), state, 0, cost)) continue;
    excess[sample] = std::max(1, shape.rows - shape.private_size);
    out.sample[sample] = cost.chi2 / excess[sample];
  }
  out.trimmed = out.sample;
  std::map<int, std::pair<double, long>> sums;
  for (const ViewResiduals& r : problem.residuals(state)) {
    const SensorModel& model = *rig.sensors[r.view->sensor].model;
    const Eigen::Index points = model.measures_pose() ? 1 : r.raw.size() / model.rows(),
                       rows = r.whitened.size() / points;
    std::vector<double> squares;
    for (Eigen::Index k = 0; k < points; ++k)
      squares.push_back(r.whitened.segment(k * rows, rows).squaredNorm());
    std::sort(squares.begin(), squares.end());
    const size_t kept = squares.size() == 1 ? 1 : squares.size() - (squares.size() + 9) / 10;
    const double worst =
        std::accumulate(squares.begin() + static_cast<std::ptrdiff_t>(kept), squares.end(), 0.0);
    out.trimmed[r.sample] -= worst / excess[r.sample];
    sums[r.view->sensor].first += r.whitened.squaredNorm();
    sums[r.view->sensor].second += r.whitened.size();
  }
  for (const auto& sum : sums)
    out.sensor[sum.first] = sum.second.first / static_cast<double>(sum.second.second);
}

/// How far freed parameters are from the rig's values, as TrialFit::moved.
std::map<std::string, Movement> movements(const Recording& recording,
                                          const std::vector<Freed>& free, const VectorXd& shared) {
  std::map<std::string, Movement> out;
  const ParameterTable& table = recording.table;
  for (const Freed& f : free) {
    const Parameter& p = table.all[f.parameter];
    Movement& moved = out[p.name];
    if (!is_given(recording.rig, p)) continue;            // it cannot have moved
    const auto include = [&](double times, double far) {  // far: m, rad or a share
      moved.times = std::max(moved.times, times);
      moved.by = std::max(moved.by, times * far);
    };
    if (p.pose) {
      const Pose change = inverse(get_pose(table.initial, p.start)) * get_pose(shared, p.start);
      const double metres = pose_scales("m").far, radians = pose_scales("rad").far;
      include(change.translation.norm() / metres, metres);
      include(log_so3(change.rotation).norm() / radians, radians);
      continue;
    }
    for (int c : f.components) {
      // (A centre is elsewhere in any cropped image; a scale of -1 hides a sign.)
      if (p.kind == ParameterKind::intrinsics && c > 1) continue;
      const double far = scales(table, {f.parameter, c}, table.initial).far,
                   change = std::abs(shared(p.start + c) - table.initial(p.start + c));
      if (far > 0 && far < kInfinity) include(change / far, scales(p.kind, p.units[c]).far);
    }
  }
  return out;
}

}  // namespace

bool good(const TrialFit& f) {
  if (!(f.per_dof() < Thresholds::good)) return false;
  return std::none_of(f.sensor.begin(), f.sensor.end(),
                      [](double s) { return s > Thresholds::good; });
}

FreedNames freed_names(const ParameterTable& table, const FitSpec& spec) {
  FreedNames out;
  out.parameter.assign(table.all.size(), 0);
  out.whole.assign(table.all.size(), 0);
  std::vector<Freed> free;
  for (const std::string& name : spec.free) merge(free, table.select(name));
  for (const Freed& f : free)
    out.parameter[f.parameter] = 1, out.whole[f.parameter] = f.whole(table.all[f.parameter]);
  return out;
}

bool frees_given_poses(const Recording& recording, const FitSpec& spec) {
  const ParameterTable& table = recording.table;
  const FreedNames freed = freed_names(table, spec);
  const auto any = [&](const std::vector<int>& poses, const std::vector<int>& mounts) {
    for (size_t i = 0; i < poses.size(); ++i)
      if (poses[i] >= 0 && is_given(recording.rig, table.all[poses[i]]) && freed.whole[mounts[i]])
        return true;
    return false;
  };
  return any(table.sensor_pose, table.sensor_mount) || any(table.target_pose, table.target_mount);
}

Recording plan_trials(const Recording& given, TrialContext& context) {
  const Recording trained = with_changed(
      given, [](const Sample& s) { return !s.train; }, [](Sample& s) { s.train = true; });
  context.usual_steps = given.rig.steps.empty();
  const Recording planned = context.usual_steps ? with_usual_steps(trained) : trained;
  check_steps(planned);
  const Rig& rig = planned.rig;
  const std::vector<StepPlan> plans = resolve_steps(planned, {});
  const ParameterTable& table = planned.table;
  std::set<int> sensors;
  std::vector<Freed> together;
  std::map<std::pair<int, int>, double> priors;
  for (size_t i = 0; i < plans.size(); ++i) {
    FitSpec spec;
    spec.sensors = rig.steps[i].sensors;
    spec.loss = rig.steps[i].loss.value_or(Loss());
    for (const Freed& f : plans[i].free)
      for (int c : f.components) {
        spec.free.push_back(table.all[f.parameter].component_name(c));
        priors.erase({f.parameter, c});
      }
    for (const Prior& p : plans[i].priors) {
      spec.priors.push_back({table.all[p.parameter].component_name(p.component), p.sigma});
      priors[{p.parameter, p.component}] = p.sigma;
    }
    merge(together, plans[i].free);
    sensors.insert(spec.sensors.begin(), spec.sensors.end());
    context.all.loss = spec.loss;
    context.steps.push_back(std::move(spec));
  }
  context.all.sensors.assign(sensors.begin(), sensors.end());
  for (const Freed& f : together)
    for (int c : f.components) context.all.free.push_back(table.all[f.parameter].component_name(c));
  for (const auto& p : priors)
    context.all.priors.push_back(
        {table.all[p.first.first].component_name(p.first.second), p.second});
  const auto unused = [&](const View& v) { return !sensors.count(v.sensor); };
  const Recording out = with_changed(  // what no step uses is not judged
      planned, [&](const Sample& s) { return std::any_of(s.views.begin(), s.views.end(), unused); },
      [&](Sample& s) {
        s.views.erase(std::remove_if(s.views.begin(), s.views.end(), unused), s.views.end());
      });
  context.given_poses_freed = frees_given_poses(out, context.all);
  return out;
}

TrialFit trial_fit(const Recording& recording, const TrialContext& context,
                   const std::vector<FitSpec>& specs, const TrialOptions& options) {
  TrialFit out;
  const ResolvedSpecs resolved = resolve(recording.table, specs);
  Values values;
  const TargetStarts how = {options.target_starts, context.memory.get()};
  const VectorXd initial = first_values(recording, resolved, options, how, values);
  for (size_t i = 0; i < specs.size(); ++i) {
    const bool last = i + 1 == specs.size();
    EstimationSetup setup;
    setup.noise = context.noise;
    setup.sensors = specs[i].sensors;
    setup.loss = options.loss.value_or(specs[i].loss);
    setup.free = resolved.free[i];
    setup.initial = initial;
    setup.priors = resolved.priors[i];
    FitOptions way;
    way.leave_out_undefined = true;
    way.targets = how;
    way.solver.threads = context.threads;
    way.solver.max_iterations = options.iterations;
    way.solver.relative_decrease = options.relative_decrease;
    if (!last)  // the next spec starts from this result
      way.solver.relative_decrease = std::max(way.solver.relative_decrease, 1e-3);
    way.solver.second_derivatives = false;  // what explains the data has small residuals
    bool gave_up = false;
    way.solver.progress = Progress([&](const Progress::News& now) {
      context.progress.check();
      // What leads there has done so after five; before, it may gain some factor in each.
      constexpr double gain = 30;
      gave_up = now.chi2 > options.give_up * std::pow(gain, std::max(0, 5 - now.iteration));
      return !gave_up;
    });
    Fit done;
    try {
      done = fit(recording, indices(recording.samples.size()), setup, std::move(values), way);
    } catch (const Cancelled&) {
      if (!gave_up) throw;
      out.chi2 = out.cost = kInfinity;
      return out;
    }
    values = std::move(done.values);
    if (last) out.undefined = std::move(done.left_out);
    const Estimation& problem = *done.problem;
    if (problem.empty() || !last) continue;
    done.problem->renew(done.state);
    out.chi2 = done.summary.cost.chi2;
    out.cost = done.summary.cost.doubled;
    out.dof = -problem.shared_size();
    out.setup = setup;
    for (size_t g = 0; g < problem.groups().size(); ++g)
      if (const int s = problem.sample_of(static_cast<int>(g)); s >= 0) out.samples.push_back(s);
    std::sort(out.samples.begin(), out.samples.end());
    out.samples.erase(std::unique(out.samples.begin(), out.samples.end()), out.samples.end());
    collect_statistics(recording, problem, done.state, out);
    out.moved = movements(recording, resolved.free[i], values.shared);
  }
  out.values = std::move(values);
  return out;
}

FitSpec with_usual_errors(const Recording& recording, FitSpec spec,
                          const std::vector<std::string>& held) {
  constexpr double kWidths = 3;  // of a robot that was built from its drawing
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  setup.sensors = spec.sensors;
  const Estimation probe(recording, indices(recording.samples.size()), setup);
  if (probe.groups().empty()) return spec;
  const std::vector<char> matters = probe.influencing();
  const ParameterTable& table = recording.table;
  std::set<std::string> freed(spec.free.begin(), spec.free.end());
  for (const std::string& name : held)
    for (const Freed& f : table.select(name))
      for (const int c : f.components) freed.insert(table.all[f.parameter].component_name(c));
  for (size_t p = 0; p < table.all.size(); ++p) {
    const ParameterKind kind = table.all[p].kind;
    if (!matters[p] || kind == ParameterKind::points || kind == ParameterKind::own_number) continue;
    for (int c = 0; c < table.all[p].size(); ++c) {
      const Component component{static_cast<int>(p), c};
      const std::string name = table.name(component);
      if (freed.count(name) || table.select(name).empty()) continue;  // (a mount that is a joint)
      spec.free.push_back(name);
      const Scales off = scales(table, component, table.initial);
      spec.priors.push_back({name, off.width < kInfinity ? std::min(kWidths * off.width, off.usual)
                                                         : std::min(off.yardstick, off.usual)});
    }
  }
  return spec;
}

TrialFit best_fit(const Recording& recording, const TrialContext& context, const FitSpec& spec,
                  const Effort& effort) {
  TrialOptions o;
  o.give_up = effort.give_up;
  o.target_starts = effort.decrease < 1e-3 ? StartEffort::refined : StartEffort::proposed;
  o.iterations = effort.iterations;
  o.relative_decrease = effort.decrease;
  TrialFit out = trial_fit(recording, context, {spec}, o);
  if ((effort.closed_form || !(out.per_dof() < Thresholds::noise)) && context.given_poses_freed) {
    o.closed_form = true;
    TrialFit other = trial_fit(recording, context, {spec}, o);
    if (other.score() < out.score() || other.undefined.size() < out.undefined.size())
      out = std::move(other);
  }
  return out;
}

TrialFit fit_as_is(const Recording& recording, const TrialContext& context) {
  TrialFit out = best_fit(recording, context, context.all, {60, 1e-7});
  if (good(out) || context.steps.size() < 2) return out;
  std::vector<FitSpec> specs = context.steps;
  specs.push_back(context.all);
  TrialOptions o;
  o.iterations = 30;
  o.relative_decrease = 1e-6;
  TrialFit other = trial_fit(recording, context, specs, o);
  return other.score() < out.score() || other.undefined.size() < out.undefined.size() ? other : out;
}

Samples some_samples(const Recording& recording, size_t unknowns) {
  const Samples& samples = recording.samples;
  std::vector<int> order = indices(samples.size());
  std::sort(order.begin(), order.end(),
            [&](int a, int b) { return samples[a].id < samples[b].id; });
  std::map<std::pair<int, int>, std::vector<int>> by_pair;
  for (int i : order)
    for (const View& v : samples[i].views) {
      std::vector<int>& list = by_pair[{v.sensor, v.target}];
      if (list.empty() || list.back() != i) list.push_back(i);
    }
  for (size_t each = 4;; each *= 2) {
    std::set<int> chosen;
    for (const auto& pair : by_pair) {
      const size_t count = pair.second.size(), take = std::min(each, count);
      size_t already = 0;
      for (int i : pair.second) already += chosen.count(i);
      for (size_t k = already; k < take; ++k) chosen.insert(pair.second[k * count / take]);
    }
    size_t rows = 0;
    for (int i : chosen)
      for (const View& v : samples[i].views) {
        const SensorModel& model = *recording.rig.sensors[v.sensor].model;
        rows += model.rows() * (model.measures_pose() ? 1 : v.ids.size());
      }
    // Once a pair may give all that it has, more cannot be had (a sample may have no views).
    const bool has_more = chosen.size() < samples.size() && each < samples.size();
    if (rows < 8 * unknowns && has_more) continue;
    Samples out;
    for (int i : chosen) out.push_back(samples[i]);
    return out;
  }
}

}  // namespace kincal
