#include "calibration.h"

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <limits>

#include "../../solver/observability.h"
#include "../analysis/leverage.h"
#include "../analysis/misfits.h"
#include "../fitting/robust.h"
#include "../fitting/starts.h"
#include "../rig/selection.h"
#include "../rig/words.h"
#include "../rig/numbers.h"

namespace kincal {
namespace {


std::vector<int> all_sensors(const Rig& rig) {
  std::vector<int> out;
  for (size_t i = 0; i < rig.sensors.size(); ++i) out.push_back(static_cast<int>(i));
  return out;
}

std::string excess_text(double ratio) {
  return text("chi2/dof is %.3g: the residuals are larger than the sigmas of the rig explain", ratio);
}

/// Sums over the residuals of one sensor.
struct Sums {
  double squared = 0, rotation = 0, whitened = 0;
  long points = 0, count = 0;
};

void add_sums(const Rig& rig, const std::vector<ViewResiduals>& residuals, std::vector<Sums>& sums) {
  for (const ViewResiduals& r : residuals) {
    Sums& s = sums[r.view->sensor];
    const SensorModel& model = *rig.sensors[r.view->sensor].model;
    if (model.whole_pose()) {
      s.squared += r.raw.head<3>().squaredNorm();
      s.rotation += r.raw.tail<3>().squaredNorm();
      ++s.points;
    } else {
      s.squared += r.raw.squaredNorm();
      s.points += r.raw.size() / model.rows();
    }
    s.whitened += r.whitened.squaredNorm();
    s.count += r.whitened.size();
  }
}

/// A sensor without any view yet.
SensorResult unseen(const Sensor& sensor) {
  SensorResult r;
  r.name = sensor.name;
  r.unit = sensor.model->unit();
  r.whole_pose = sensor.model->whole_pose();
  for (SplitStatistics* s : {&r.train, &r.test})
    s->rms_before = s->rms = s->rms_as_read = s->rotation_before = s->rotation = s->rotation_as_read = kNan;
  return r;
}

}  // namespace

struct Calibration::Judged {
  bool converged = true;
  double chi2 = 0;
  long dof = 0;
  std::vector<Sums> sums;  // by sensor
  std::vector<ViewResiduals> residuals;
  std::vector<std::string> undefined;  // samples without any evaluable start
};

Calibration::Calibration(Rig rig, std::vector<Sample> samples)
    : recording_(std::move(rig), std::move(samples)), initial_(recording_.table.initial) {
  if (recording_.samples.empty()) throw std::invalid_argument("there are no samples");
  const std::vector<int> train = recording_.split(true);
  for (const Step& step : recording_.rig.steps) {
    EstimationSetup setup;
    setup.initial = initial_;
    setup.noise = NoiseMode::none;
    setup.sensors = step.sensors;
    const Estimation probe(recording_, train, setup);
    used_.push_back(probe.groups().empty() ? std::vector<char>() : probe.influencing());
    resolve(used_.size() - 1, {}, {});
  }
}

/// Starts the free targets of the samples; those of them where that can be done and no residual is undefined then.
std::vector<int> Calibration::that_can_start(const std::vector<int>& samples, const std::vector<int>& sensors, Values& values) const {
  EstimationSetup setup;
  setup.initial = initial_;
  setup.noise = NoiseMode::none;
  setup.sensors = sensors;
  std::vector<int> out;
  for (int i : samples) {
    Estimation one(recording_, {i}, setup);
    Cost cost;
    bool defined = true;
    try {
      start_targets(recording_, {i}, sensors, {LossKind::soft_l1, 3}, values);
      const VectorXd state = one.pack(values);
      one.renew(state);
      defined = one.groups().empty() || (one.evaluate(0, state, 0, cost) && std::isfinite(cost.twice));
    } catch (const std::runtime_error&) {
      defined = false;
    }
    if (defined) out.push_back(i);
  }
  return out;
}

std::vector<const Step*> Calibration::steps_to_run(const CalibrationOptions& options) const {
  if (recording_.rig.steps.empty()) throw std::invalid_argument("the rig has no `estimate`: nothing is to be calibrated");
  std::vector<const Step*> out;
  std::string names;
  for (const Step& step : recording_.rig.steps) {
    out.push_back(&step);
    if (step.name == options.last_step) return out;
    names += (names.empty() ? "" : ", ") + step.name;
  }
  if (!options.last_step.empty()) throw std::invalid_argument("--step: there is no step '" + options.last_step + "'; the rig has " + names);
  return out;
}

/// A step's plan but for its counts.
StepPlan Calibration::resolve(size_t index, const std::vector<std::string>& free, const std::vector<std::string>& fix) const {
  const Step& step = recording_.rig.steps[index];
  StepPlan plan;
  plan.name = step.name;
  std::vector<Freed> wanted;
  std::vector<char> plain(recording_.table.all.size(), 0);
  const auto want = [&](const std::string& pattern, const std::string& where) {
    const std::vector<Freed> found = recording_.table.find(pattern, where);
    if (recording_.table.is_plain_name(pattern)) plain[found[0].parameter] = 1;
    merge(wanted, found);
  };
  for (size_t i = 0; i < step.free.size(); ++i)
    want(step.free[i], i < step.free_where.size() ? step.free_where[i] : "step '" + step.name + "': free");
  for (const std::string& pattern : free) want(pattern, "--free");

  std::vector<char> seen_in_training(recording_.rig.targets.size(), 0), seen_held_out(recording_.rig.targets.size(), 0);
  for (const Sample& s : recording_.samples)
    for (const View& v : s.views) (s.train ? seen_in_training : seen_held_out)[v.target] = 1;
  const std::vector<char>& used = used_[index];
  if (used.empty()) throw std::invalid_argument("step '" + step.name + "': no training sample has a view of its sensors");

  std::vector<Freed> with_priors = wanted;  // priors are checked against what the step means to free
  for (const std::string& pattern : fix) {
    const std::vector<Freed> found = recording_.table.find(pattern, "--fix");
    for (const Freed& f : found)
      for (Freed& w : wanted)
        if (w.parameter == f.parameter) {
          std::vector<int> left;
          std::set_difference(w.components.begin(), w.components.end(), f.components.begin(), f.components.end(), std::back_inserter(left));
          w.components = left;
        }
  }
  for (const Freed& f : wanted) {
    if (f.components.empty()) continue;
    const auto target = std::find(recording_.table.target_pose.begin(), recording_.table.target_pose.end(), f.parameter);
    if (target != recording_.table.target_pose.end()) {
      const size_t t = static_cast<size_t>(target - recording_.table.target_pose.begin());
      if (seen_held_out[t] && !seen_in_training[t]) {
        plan.held_out.push_back(recording_.table.all[f.parameter].name);
        continue;
      }
    }
    if (!used[f.parameter] && !plain[f.parameter])
      plan.unused.push_back(recording_.table.all[f.parameter].name);
    else
      plan.free.push_back(f);
  }
  if (plan.free.empty()) {
    std::string why;
    for (const std::string& n : plan.unused) why += (why.empty() ? "; no measurement of it depends on " : ", ") + n;
    for (const std::string& n : plan.held_out) why += "; only held-out samples see " + n;
    throw std::invalid_argument("step '" + step.name + "' frees nothing" + why);
  }

  for (const PriorSetting& prior : step.priors) {
    const std::vector<Freed> found = recording_.table.find(prior.pattern, prior.where);
    bool covers = false;
    for (const Freed& f : found) {
      if (prior.split && !recording_.table.all[f.parameter].pose)
        throw std::invalid_argument(prior.where + ": '" + recording_.table.all[f.parameter].name +
                                    "' is no pose: a number is expected, not {translation, rotation}");
      const Freed* meant = find_freed(with_priors, f.parameter);
      const Freed* freed = find_freed(plan.free, f.parameter);
      for (int c : f.components) {
        if (meant && std::count(meant->components.begin(), meant->components.end(), c)) covers = true;
        if (!freed || !std::count(freed->components.begin(), freed->components.end(), c)) continue;
        plan.priors.erase(std::remove_if(plan.priors.begin(), plan.priors.end(),
                                         [&](const Prior& p) { return p.parameter == f.parameter && p.component == c; }),
                          plan.priors.end());  // later entries win
        plan.priors.push_back({f.parameter, c, prior.split && c >= 3 ? prior.rotation : prior.translation});
      }
    }
    if (!covers) throw std::invalid_argument(prior.where + ": '" + prior.pattern + "' covers nothing that this step frees");
  }
  return plan;
}

std::vector<StepPlan> Calibration::resolve_all(const CalibrationOptions& options) const {
  std::vector<StepPlan> out;
  const size_t count = steps_to_run(options).size();
  for (size_t i = 0; i < count; ++i) out.push_back(i + 1 == count ? resolve(i, options.free, options.fix) : resolve(i, {}, {}));
  return out;
}

/// What is said of each of `free` and `fix` without which the last step would do the same.
std::vector<std::string> Calibration::without_effect(const CalibrationOptions& options) const {
  const size_t last = steps_to_run(options).size() - 1;
  const auto freed = [&](const std::vector<std::string>& free, const std::vector<std::string>& fix) {
    std::map<int, std::vector<int>> out;
    for (const Freed& f : resolve(last, free, fix).free) out[f.parameter] = f.components;
    return out;
  };
  const std::map<int, std::vector<int>> all = freed(options.free, options.fix);
  std::vector<std::string> out;
  for (const bool fix : {false, true}) {
    const std::vector<std::string>& patterns = fix ? options.fix : options.free;
    for (size_t i = 0; i < patterns.size(); ++i) {
      std::vector<std::string> others = patterns;
      others.erase(others.begin() + static_cast<std::ptrdiff_t>(i));
      try {
        if (freed(fix ? options.free : others, fix ? others : options.fix) != all) continue;
      } catch (const std::invalid_argument&) {  // without it the step would free nothing, or a prior would cover nothing
        continue;
      }
      bool free = false;
      for (const Freed& f : recording_.table.select(patterns[i])) free = free || all.count(f.parameter);
      const std::string step = "step '" + recording_.rig.steps[last].name + "'";
      out.push_back((fix ? "--fix '" : "--free '") + patterns[i] + "' changes nothing: " +
                    (fix    ? "it is not free in " + step + " anyway"
                     : free ? "it is free in " + step + " anyway"
                            : "no measurement of " + step + " depends on it, or --fix holds it"));
    }
  }
  return out;
}

std::vector<StepPlan> Calibration::plan(const CalibrationOptions& options) const {
  std::vector<StepPlan> out = resolve_all(options);
  out.back().without_effect = without_effect(options);
  const std::vector<int> train = recording_.split(true);
  for (size_t i = 0; i < out.size(); ++i) {
    StepPlan& plan = out[i];
    EstimationSetup setup;
    setup.initial = initial_;
    setup.noise = options.noise;
    setup.sensors = recording_.rig.steps[i].sensors;
    setup.free = plan.free;
    setup.priors = plan.priors;
    const Estimation problem(recording_, train, setup);
    plan.unknowns = problem.shared_size();
    for (size_t g = 0; g < problem.groups().size(); ++g) {
      plan.rows += problem.groups()[g].rows;
      plan.unknowns += problem.groups()[g].private_size;
      plan.samples += problem.sample_of(static_cast<int>(g)) >= 0;
    }
  }
  return out;
}

std::optional<CalibrationResult> Calibration::run(const CalibrationOptions& options) {
  const std::vector<const Step*> steps = steps_to_run(options);
  const std::vector<StepPlan> plans = resolve_all(options);
  const std::vector<int> train = recording_.split(true);
  CalibrationResult result;
  result.noise = options.noise;
  result.values.shared = initial_;
  for (const std::string& said : without_effect(options)) result.warnings.push_back({"no_effect", said});

  // Poses that the rig leaves open and the steps free wholly, without a prior: their T0 comes from the data.
  std::vector<int> unknown;
  std::vector<std::string> identity;  // freed in part or with a prior: absent means the identity
  for (size_t p = 0; p < recording_.table.all.size(); ++p) {
    const auto sensor = std::find(recording_.table.sensor_pose.begin(), recording_.table.sensor_pose.end(), static_cast<int>(p));
    const auto target = std::find(recording_.table.target_pose.begin(), recording_.table.target_pose.end(), static_cast<int>(p));
    const bool open = (sensor != recording_.table.sensor_pose.end() && !recording_.rig.sensors[sensor - recording_.table.sensor_pose.begin()].pose_given) ||
                      (target != recording_.table.target_pose.end() && !recording_.rig.targets[target - recording_.table.target_pose.begin()].pose_given);
    if (!open) continue;
    bool whole = false, prior = false;
    for (const StepPlan& plan : plans) {
      const Freed* f = find_freed(plan.free, static_cast<int>(p));
      whole = whole || (f && f->whole(recording_.table.all[p]));
      for (const Prior& q : plan.priors) prior = prior || q.parameter == static_cast<int>(p);
    }
    if (whole && !prior)
      unknown.push_back(static_cast<int>(p));
    else if (std::any_of(plans.begin(), plans.end(), [&](const StepPlan& plan) { return find_freed(plan.free, static_cast<int>(p)); }))
      identity.push_back(recording_.table.all[p].name);
  }
  for (const std::string& name : identity)
    result.warnings.push_back(
        {"identity", name + " is absent from the rig and freed in part or with a prior: its initial value is the identity"});
  for (int p : unknown) result.computed_starts.push_back(recording_.table.all[p].name);
  if (!unknown.empty()) {
    Values started;
    started.shared = initial_;
    for (const std::string& name : start_unknown_poses(recording_, train, unknown, started))
      result.warnings.push_back(
          {"no_start", name + " is absent from the rig and nothing with a known pose ties it down: it starts at the identity"});
    initial_ = result.values.shared = started.shared;
  }
  if (options.start) result.values.shared = *options.start;

  bool all_converged = true;
  std::vector<Freed> held_out;
  for (size_t i = 0; i < steps.size(); ++i) {
    const Step& step = *steps[i];
    const auto begin = std::chrono::steady_clock::now();
    EstimationSetup setup;
    setup.initial = initial_;
    setup.noise = options.noise;
    setup.loss = options.robust ? Loss{LossKind::cauchy, 3, true} : step.loss.value_or(Loss());
    setup.sensors = step.sensors;
    setup.free = plans[i].free;
    setup.priors = plans[i].priors;
    if (options.scatter) options.scatter(plans[i], result.values.shared);
    const std::vector<int> taking_part = options.robust ? that_can_start(train, step.sensors, result.values) : train;
    if (taking_part.empty()) throw std::runtime_error("step '" + step.name + "': no sample can start: points lie behind their cameras");
    Estimation problem(recording_, taking_part, setup);
    if (!options.robust) start_targets(recording_, taking_part, step.sensors, setup.loss, result.values);
    VectorXd state = problem.pack(result.values);

    StepResult out;
    out.name = step.name;
    out.unused = plans[i].unused;
    out.held_out = plans[i].held_out;
    SolverOptions solver_options;
    solver_options.threads = options.threads;
    solver_options.linear_solver = options.linear_solver;
    if (options.progress) {
      solver_options.progress = [&](int iteration, double chi2, double damping) {
        return options.progress(step.name, iteration, chi2, damping);
      };
      if (!options.progress(step.name, 0, kNan, kNan)) return std::nullopt;
    }
    LevenbergMarquardt solver(problem, solver_options);
    SolveSummary summary;
    if (setup.loss.from_data) summary = solve_graduated(problem, recording_.rig, solver_options, state);
    if (!options.robust && summary.outcome != Outcome::undefined_start && summary.outcome != Outcome::cancelled)
      summary = solver.solve(state);
    if (summary.outcome == Outcome::cancelled) return std::nullopt;
    if (summary.outcome == Outcome::undefined_start) {
      const Sample& sample = recording_.samples[problem.sample_of(summary.undefined_group)];
      std::string views;
      for (const View& v : sample.views)
        if (std::count(step.sensors.begin(), step.sensors.end(), v.sensor))
          views += (views.empty() ? "'" : ", '") + recording_.rig.sensors[v.sensor].name + "' of '" + recording_.rig.targets[v.target].name + "'";
      throw std::runtime_error(
          "step '" + step.name + "': in sample '" + sample.id +
          "' a residual is undefined at the start: a point lies behind a camera, or a number is not finite. Its views: " + views +
          ". Check poses, joint readings and the sensor's link");
    }
    problem.unpack(state, result.values);
    problem.renew(state);
    const bool last = i + 1 == steps.size();
    std::vector<MatrixXd> left;
    const Observability observability = observe(problem, state, last && options.judge ? &left : nullptr);
    out.linear_solver = solver.linear_solver();
    out.converged = summary.outcome == Outcome::converged;
    all_converged = all_converged && out.converged;
    out.iterations = summary.iterations;
    out.history = summary.history;
    out.chi2_initial = summary.history.front().first;
    out.chi2 = summary.cost.chi2;
    out.cost = summary.cost.twice / 2;
    out.dof = observability.dof();
    for (const auto& direction : observability.directions) {
      Direction named;
      for (const auto& c : direction) named.push_back({problem.column_name(c.first), c.second});
      out.unobservable.push_back(std::move(named));
    }
    out.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();

    for (size_t column = 0; column < problem.columns().size(); ++column) {
      const int p = problem.columns()[column].parameter, component = problem.columns()[column].index;
      const Parameter& parameter = recording_.table.all[p];
      auto estimate = std::find_if(result.parameters.begin(), result.parameters.end(),
                                   [&](const ParameterEstimate& e) { return e.name == parameter.name; });
      if (estimate == result.parameters.end()) {
        result.parameters.push_back({});
        estimate = result.parameters.end() - 1;
        estimate->name = parameter.name;
        estimate->components = parameter.components;
        estimate->units = parameter.units;
        estimate->freed.assign(parameter.size(), 0);
      }
      if (column == 0 || problem.columns()[column - 1].parameter != p) {
        estimate->step = step.name;
        estimate->sigma.assign(parameter.size(), 0.0);
        estimate->prior.assign(parameter.size(), 0.0);
        for (const Prior& prior : plans[i].priors)
          if (prior.parameter == p) estimate->prior[prior.component] = prior.sigma;
      }
      const Eigen::Index c = static_cast<Eigen::Index>(column);
      estimate->freed[component] = 1;
      estimate->sigma[component] = observability.unobservable[column] ? kNan : std::sqrt(std::max(0.0, observability.covariance(c, c)));
    }
    result.steps.push_back(std::move(out));
    for (const std::string& pattern : step.free)  // what only held-out samples see is estimated when they are judged
      for (const Freed& f : recording_.table.select(pattern))
        if (std::count(plans[i].held_out.begin(), plans[i].held_out.end(), recording_.table.all[f.parameter].name)) merge(held_out, {f});
    if (!last) continue;

    const StepResult& end = result.steps.back();
    result.chi2 = end.chi2;
    result.cost = end.cost;
    result.dof = end.dof;
    result.unobservable = end.unobservable;
    result.status = !all_converged ? Status::not_converged : !end.unobservable.empty() ? Status::unobservable : Status::converged;
    result.covariance = observability.covariance;
    result.setup = problem.setup();
    if (options.judge)
      for (const Influence& f : influences(problem.groups(), left, observability))
        if (problem.sample_of(f.group) >= 0)
          result.leverage.push_back({recording_.samples[problem.sample_of(f.group)].id, problem.column_name(f.column), f.sigmas});
    for (int c = 0; c < problem.shared_size(); ++c) result.covariance_names.push_back(problem.column_name(c));
    for (ParameterEstimate& e : result.parameters) {
      const Parameter& parameter =
          *std::find_if(recording_.table.all.begin(), recording_.table.all.end(), [&](const Parameter& q) { return q.name == e.name; });
      const VectorXd& v = result.values.shared;
      if (parameter.pose) {
        const Vector6d xi = log_se3(inverse(get_pose(initial_, parameter.start)) * get_pose(v, parameter.start));
        e.initial.assign(6, 0.0);
        e.value.assign(xi.data(), xi.data() + 6);
        for (int c = 0; c < 6; ++c)
          if (!e.freed[c]) e.value[c] = 0;  // exactly: log and exp leave 1e-19
        e.pose = get_pose(v, parameter.start);
      } else {
        e.initial.assign(initial_.data() + parameter.start, initial_.data() + parameter.start + parameter.size());
        e.value.assign(v.data() + parameter.start, v.data() + parameter.start + parameter.size());
      }
    }
    if (options.robust) return result;
    if (!options.judge) continue;
    result.explanation = explain(*this, result);
    result.noise_levels = noise_levels(problem, recording_.rig, state, observability.covariance);
    collect(result, problem, state, step, held_out);
  }
  warn(result);
  if (options.judge)
    for (Warning& w : misfits(*this, result)) result.warnings.push_back(std::move(w));
  return result;
}

/// Residuals of the given samples with everything shared held but `free`; targets and joint errors estimated, sample by sample, or
/// together where samples depend on something in `free`. `start`: poses to start free targets from, else by proposals.
Calibration::Judged Calibration::judge(const std::vector<int>& samples, const VectorXd& shared, NoiseMode noise, const Loss& loss,
                                       const std::vector<Freed>& free, const Values* start, bool with_dof,
                                       const std::vector<double>& levels) const {
  Judged out;
  out.sums.resize(recording_.rig.sensors.size());
  EstimationSetup setup;
  setup.initial = initial_;
  setup.noise = noise;
  setup.loss = loss;
  setup.levels = levels;
  setup.sensors = all_sensors(recording_.rig);
  std::vector<std::vector<int>> groups(1);
  for (int i : samples) {
    bool tied = false;
    if (!free.empty()) {
      const std::vector<char> used = Estimation(recording_, {i}, setup).influencing();
      for (const Freed& f : free) tied = tied || used[f.parameter];
    }
    if (tied)
      groups[0].push_back(i);
    else
      groups.push_back({i});
  }
  for (const std::vector<int>& group : groups) {
    if (group.empty()) continue;
    if (&group == &groups[0])
      setup.free = free;
    else
      setup.free.clear();
    Estimation problem(recording_, group, setup);
    if (problem.groups().empty()) continue;
    Values values;
    values.shared = shared;
    std::vector<int> to_start;
    for (int i : group)
      for (const View& v : recording_.samples[i].views) {
        if (recording_.rig.targets[v.target].link >= 0) continue;
        const auto known = start ? start->targets.find({i, v.target}) : std::map<std::pair<int, int>, Pose>::const_iterator();
        if (start && known != start->targets.end())
          values.targets[{i, v.target}] = known->second;
        else if (to_start.empty() || to_start.back() != i)
          to_start.push_back(i);
      }
    VectorXd state;
    SolveSummary summary;
    const auto solve = [&] {
      state = problem.pack(values);
      summary = LevenbergMarquardt(problem, SolverOptions()).solve(state);
      return summary.outcome != Outcome::undefined_start;
    };
    bool defined = true;
    try {
      start_targets(recording_, to_start, setup.sensors, loss, values);
      if (!solve()) {  // the given poses are behind a camera at these values
        values.targets.clear();
        start_targets(recording_, group, setup.sensors, loss, values);
        defined = solve();
      }
    } catch (const std::runtime_error&) {
      defined = false;
    }
    if (!defined) {
      for (int i : group) out.undefined.push_back(recording_.samples[i].id);
      continue;
    }
    out.converged = out.converged && summary.outcome == Outcome::converged;
    out.chi2 += summary.cost.chi2;
    if (with_dof) {
      problem.renew(state);
      out.dof += observe(problem, state).dof();
    }
    std::vector<ViewResiduals> residuals = problem.residuals(state);
    add_sums(recording_.rig, residuals, out.sums);
    std::move(residuals.begin(), residuals.end(), std::back_inserter(out.residuals));
  }
  return out;
}

/// The table of residuals, before, after and as read, of both splits.
void Calibration::collect(CalibrationResult& result, const Estimation& last, const VectorXd& state, const Step& last_step,
                          const std::vector<Freed>& held_out) const {
  const Loss loss = last_step.loss.value_or(Loss());
  const std::vector<double>& levels = last.setup().levels;
  std::vector<char> sees(recording_.rig.sensors.size(), 0);
  bool complete = true;  // the last step used every sensor that sees something in training
  for (const Sample& s : recording_.samples)
    for (const View& v : s.views) {
      sees[v.sensor] = 1;
      if (s.train && !std::count(last_step.sensors.begin(), last_step.sensors.end(), v.sensor)) complete = false;
    }
  std::vector<int> place(recording_.rig.sensors.size(), -1);
  for (size_t i = 0; i < recording_.rig.sensors.size(); ++i)
    if (sees[i]) {
      place[i] = static_cast<int>(result.sensors.size());
      result.sensors.push_back(unseen(recording_.rig.sensors[i]));
    }
  const auto order = [](std::vector<ViewResiduals>& residuals) {
    std::stable_sort(residuals.begin(), residuals.end(), [](const ViewResiduals& a, const ViewResiduals& b) {
      return a.sample != b.sample ? a.sample < b.sample : a.view < b.view;
    });
  };
  for (bool train : {true, false}) {
    const std::vector<int> samples = recording_.split(train);
    if (samples.empty()) continue;
    const std::vector<Freed> free = train ? std::vector<Freed>() : held_out;
    Judged now;
    if (train && complete) {
      now.sums.resize(recording_.rig.sensors.size());
      now.residuals = last.residuals(state);
      add_sums(recording_.rig, now.residuals, now.sums);
    } else {
      now = judge(samples, result.values.shared, result.noise, loss, free, &result.values, false, levels);
    }
    Judged read = judge(samples, result.values.shared, NoiseMode::none, loss, free, &result.values, false, levels);
    Judged before = judge(samples, initial_, NoiseMode::none, loss, free, &result.values, false, levels);
    for (size_t i = 0; i < recording_.rig.sensors.size(); ++i) {
      if (place[i] < 0) continue;
      SplitStatistics& s = train ? result.sensors[place[i]].train : result.sensors[place[i]].test;
      const auto rms = [](double squared, long points) { return points ? std::sqrt(squared / points) : kNan; };
      s.points = now.sums[i].points;
      s.rms = rms(now.sums[i].squared, now.sums[i].points);
      s.rms_as_read = rms(read.sums[i].squared, read.sums[i].points);
      s.rms_before = rms(before.sums[i].squared, before.sums[i].points);
      if (result.sensors[place[i]].whole_pose) {
        s.rotation = rms(now.sums[i].rotation, now.sums[i].points);
        s.rotation_as_read = rms(read.sums[i].rotation, read.sums[i].points);
        s.rotation_before = rms(before.sums[i].rotation, before.sums[i].points);
      }
      s.whitened_squared = now.sums[i].whitened;
      s.whitened_count = now.sums[i].count;
    }
    for (const std::string& id : before.undefined)
      result.warnings.push_back(
          {"undefined_before",
           "sample '" + id + "' cannot be evaluated at the rig's values (a point behind a camera): it is missing from rms_before"});
    for (const std::string& id : now.undefined)
      result.warnings.push_back(
          {"undefined",
           "held-out sample '" + id + "' cannot be evaluated at the estimate (a point behind a camera): it is missing from its rms"});
    order(now.residuals);
    order(before.residuals);
    order(read.residuals);
    std::move(now.residuals.begin(), now.residuals.end(), std::back_inserter(result.residuals));
    std::move(before.residuals.begin(), before.residuals.end(), std::back_inserter(result.residuals_before));
    std::move(read.residuals.begin(), read.residuals.end(), std::back_inserter(result.residuals_as_read));
  }
}

void Calibration::warn(CalibrationResult& result) const {
  const auto add = [&](const char* id, std::string t) { result.warnings.push_back({id, std::move(t)}); };
  for (const StepResult& s : result.steps)
    if (!s.converged) add("not_converged", "step '" + s.name + "' did not converge in " + std::to_string(s.iterations) + " iterations");
  for (size_t i = 0; i < result.unobservable.size(); ++i) {
    const Direction& d = result.unobservable[i];
    std::string sum;
    for (const auto& c : d) sum += (sum.empty() ? "" : " ") + text("%+.4g ", c.second) + c.first;
    const std::string why = i < result.explanation.weak.size()
                                ? result.explanation.weak[i].why + ". Cure: " + result.explanation.weak[i].cure
                                : "hold one of these or give it a prior";
    add("unobservable", "the data do not determine " + sum + ": " + why + "; their sigmas are unknown");
  }
  if (result.dof > 0 && result.chi2 / result.dof > 1.5) add("chi2", excess_text(result.chi2 / result.dof));
  if (result.dof > 0 && result.chi2 / result.dof < 1 / 1.5 && result.noise != NoiseMode::point)  // there it says nothing
    add("chi2", text("chi2/dof is %.3g: the residuals are smaller than the sigmas of the rig say; the sigmas of the result are too large",
                     result.chi2 / result.dof));
  for (const SensorResult& s : result.sensors)
    if (s.train.whitened_count && s.train.whitened_squared / s.train.whitened_count > 1.5)
      add("chi2", "sensor '" + s.name + "': " +
                      text("chi2/n is %.3g, its residuals are %.2g times its sigma", s.train.whitened_squared / s.train.whitened_count,
                           std::sqrt(s.train.whitened_squared / s.train.whitened_count)));
  struct Excess {
    int count = 0, sample = -1;
    double worst = 0;
  };
  std::map<int, Excess> excess;  // by joint
  for (const auto& e : result.values.errors) {
    const double sigmas = e.second / recording_.rig.joints[e.first.second].sigma;
    if (result.noise != NoiseMode::latent || !(std::abs(sigmas) > 4)) continue;
    Excess& x = excess[e.first.second];
    ++x.count;
    if (std::abs(sigmas) > std::abs(x.worst)) x.worst = sigmas, x.sample = e.first.first;
  }
  for (const auto& x : excess)
    add("joint_error", "joint '" + recording_.rig.tree.joints[x.first].name + "': its error exceeds 4 sigmas in " + std::to_string(x.second.count) +
                           (x.second.count == 1 ? " sample" : " samples") + ", at worst " +
                           text("%+.3g sigmas (%.3g) in sample '", x.second.worst, x.second.worst * recording_.rig.joints[x.first].sigma) +
                           recording_.samples[x.second.sample].id + "'");
  for (const ParameterEstimate& e : result.parameters) {
    const auto about_it = [&](const Warning& w) { return w.id == "identity" && w.text.rfind(e.name + " ", 0) == 0; };
    if (e.pose && std::none_of(result.warnings.begin(), result.warnings.end(), about_it)) {
      const double moved = std::hypot(e.value[0], e.value[1], e.value[2]), turned = std::hypot(e.value[3], e.value[4], e.value[5]);
      if (moved > 0.1) add("moved", e.name + text(" moved by %.3g m from its initial value: is that possible?", moved));
      if (turned > 10 * M_PI / 180)
        add("moved", e.name + text(" turned by %.3g degrees from its initial value: is that possible?", turned * 180 / M_PI));
    }
    for (size_t c = 0; c < e.value.size(); ++c) {
      const std::string name = e.components[c].empty() ? e.name : e.name + "." + e.components[c];
      if (e.prior[c] > 0 && std::abs(e.value[c] - e.initial[c]) > 3 * e.prior[c])
        add("prior", name + text(" is %.1f prior sigmas from its prior", (e.value[c] - e.initial[c]) / e.prior[c]));
      if (e.units[c] == "m" && e.sigma[c] > 0.01) add("sigma", name + text(" is known to %.3g m only (one sigma)", e.sigma[c]));
      if (e.units[c] == "rad" && e.sigma[c] > M_PI / 180)
        add("sigma", name + text(" is known to %.3g degrees only (one sigma)", e.sigma[c] * 180 / M_PI));
    }
  }
}

Evaluation Calibration::evaluate(NoiseMode noise, const std::vector<std::string>& patterns) const {
  std::vector<Freed> free;
  std::vector<char> plain(recording_.table.all.size(), 0);
  for (const std::string& pattern : patterns) {
    const std::vector<Freed> found = recording_.table.find(pattern, "--free");
    if (recording_.table.is_plain_name(pattern)) plain[found[0].parameter] = 1;
    merge(free, found);
  }
  Evaluation out;
  std::vector<char> influences(recording_.table.all.size(), 0);  // some view depends on it
  std::vector<int> place(recording_.rig.sensors.size(), -1);
  for (bool train : {true, false}) {
    const std::vector<int> samples = recording_.split(train);
    if (samples.empty()) continue;
    EstimationSetup setup;
    setup.initial = initial_;
    setup.sensors = all_sensors(recording_.rig);
    const std::vector<char> used = Estimation(recording_, samples, setup).influencing();
    std::vector<Freed> here;
    for (const Freed& f : free)
      if (used[f.parameter] || plain[f.parameter]) here.push_back(f);
    for (size_t p = 0; p < used.size(); ++p) influences[p] |= used[p];
    const Judged now = judge(samples, initial_, noise, Loss(), here, nullptr, true);
    const Judged read = judge(samples, initial_, NoiseMode::none, Loss(), here, nullptr, false);
    if (!now.undefined.empty())
      throw std::runtime_error("sample '" + now.undefined[0] +
                               "' cannot be evaluated: a point lies behind a camera wherever its target is put");
    out.converged = out.converged && now.converged;
    out.chi2 += now.chi2;
    out.dof += now.dof;
    for (size_t i = 0; i < recording_.rig.sensors.size(); ++i) {
      if (now.sums[i].points == 0) continue;
      if (place[i] < 0) {
        place[i] = static_cast<int>(out.sensors.size());
        out.sensors.push_back(unseen(recording_.rig.sensors[i]));
      }
      SplitStatistics& s = train ? out.sensors[place[i]].train : out.sensors[place[i]].test;
      s.points = now.sums[i].points;
      s.rms = std::sqrt(now.sums[i].squared / s.points);
      s.rms_as_read = std::sqrt(read.sums[i].squared / read.sums[i].points);
      s.whitened_squared = now.sums[i].whitened;
      s.whitened_count = now.sums[i].count;
      if (out.sensors[place[i]].whole_pose) {
        s.rotation = std::sqrt(now.sums[i].rotation / s.points);
        s.rotation_as_read = std::sqrt(read.sums[i].rotation / read.sums[i].points);
      }
    }
  }
  const auto add = [&](const char* id, std::string t) { out.warnings.push_back({id, std::move(t)}); };
  if (!out.converged) add("not_converged", "the estimation of targets or joint errors did not converge");
  if (out.dof > 0 && out.chi2 / out.dof > 1.5) add("chi2", excess_text(out.chi2 / out.dof));
  for (const std::string& pattern : patterns) {
    const std::vector<Freed> found = recording_.table.select(pattern);
    if (std::none_of(found.begin(), found.end(), [&](const Freed& f) { return influences[f.parameter]; }))
      add("no_effect", "--free '" + pattern + "' changes nothing: no measurement depends on it");
  }
  return out;
}

}  // namespace kincal
