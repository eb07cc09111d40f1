#include "doctor.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <stdexcept>

#include "../calibration/calibration.h"
#include "hypotheses.h"
#include "../fitting/starts.h"
#include "../rig/numbers.h"
#include "../rig/selection.h"

namespace kincal {
namespace {

using Samples = std::vector<Sample>;

constexpr double kGood = 1.5;         // chi2/dof that needs no explanation, of the whole and of each sensor
constexpr double kNoise = 3;          // chi2/dof that is noise, sigmas being guesses
constexpr double kClean = 1.3;        // chi2/dof that proves the sigmas,
constexpr double kEnough = 1.6;       // and the factor of chi2 that decides where it is reached with (all but) the same unknowns,
constexpr double kDecisive = 4;       // factor of chi2 that decides where noise remains,
constexpr double kOverwhelming = 12;  // and where more than that remains
constexpr double kFar = 0.25;         // movement that a start value should not need: m, rad, share of a length
constexpr double kSampleExcess = 25;  // mean square of a bad sample's rows over the median sample's
constexpr double kMostBad = 0.4;      // share of samples that may be bad
constexpr double kWorth = 10;         // by which leaving samples out must be better than what keeps them
constexpr int kMostRounds = 4;

struct Cancelled {};

/// Median of the finite numbers; NaN: there is none.
double median_of_finite(std::vector<double> numbers) {
  numbers.erase(std::remove_if(numbers.begin(), numbers.end(), [](double x) { return !std::isfinite(x); }), numbers.end());
  return median(std::move(numbers));
}

// ------------------------------------------------------------------------------------------------ fits
/// What one minimisation frees, by name, so that it fits rigs whose tables differ.
struct Stage {
  std::vector<int> sensors;
  std::vector<std::string> free;                       // components
  std::vector<std::pair<std::string, double>> priors;  // component, sigma
  Loss loss;
};

struct FitOptions {
  int iterations = 100;
  double relative_decrease = 1e-9;
  bool closed_form = false;  // for given poses too that are freed wholly
  const Values* start = nullptr;
  std::optional<Loss> loss;
  bool refine = true;          // starts of free targets
  double give_up = kInfinity;  // chi2 that after some iterations is not worth more
};

struct Fit {
  double chi2 = 0, cost = 0;
  long dof = 0;
  std::vector<int> undefined;  // samples without a start, or with a point behind a camera there; not in chi2
  VectorXd given;              // the rig's values
  Values values;
  std::vector<double> sample;           // mean square of a sample's rows, by index; NaN: not part of it
  std::vector<double> most;             // the same without the worst tenth of each view's points
  std::vector<double> sensor;           // of a sensor's residuals
  std::map<std::string, double> moved;  // how far freed parameters are from the rig's values: m, rad, share of a length

  double farthest() const {
    double out = 0;
    for (const auto& m : moved) out = std::max(out, m.second);
    return out;
  }

  bool complete() const { return undefined.empty() && std::isfinite(chi2); }
  double score() const { return complete() ? cost : kInfinity; }
  double per_dof() const { return complete() ? chi2 / static_cast<double>(std::max(1L, dof)) : kInfinity; }
};

/// By how much an estimate is nearer to the rig's values than another: of a parameter that the other moved far, and this one at most a fifth of
/// that. 0 if there is none, or if it moves others farther.
double nearer(const Fit& than, const Fit& f) {
  double gain = 0, loss = 0;
  for (const auto& m : than.moved) {
    const auto here = f.moved.find(m.first);
    if (here == f.moved.end()) return 0;
    if (m.second > kFar && here->second < 0.2 * m.second) gain = std::max(gain, m.second - here->second);
    loss = std::max(loss, here->second - m.second);
  }
  return loss < 0.2 * gain ? gain : 0;
}

class Doctor {
 public:
  Doctor(const Rig& rig, const Samples& samples, const DoctorOptions& options) : options_(options), rig_(rig), samples_(samples) {
    for (Sample& s : samples_) s.train = true;
    plan();
  }

  Diagnosis run();

 private:
  void plan();
  Fit fit(const Rig& rig, const Samples& samples, const std::vector<Stage>& stages, const FitOptions& o) const;
  Fit best_fit(const Rig& rig, const Samples& samples, const Stage& stage, int iterations, double decrease, bool new_poses,
               double give_up = kInfinity) const;
  Samples some_samples() const;
  Fit as_is() const;
  Fit robust_fit() const;
  bool good(const Fit& f) const;
  bool believed(const Fit& before, const Fit& now, double now_cost, bool strict) const;
  bool open_poses() const;
  FreedNames freed_names(const ParameterTable& table) const;
  void step(int done, int of) const {
    if (options_.progress && !options_.progress(done, of)) throw Cancelled();
  }
  void check_still_joints(std::vector<Finding>& out) const;
  void check_connections(std::vector<Finding>& out) const;
  std::optional<Hypothesis> bad_samples(const Fit& robust) const;
  std::vector<Hypothesis> turned_views(const Fit& robust) const;
  bool explain(Fit& now, bool by_movement, std::vector<Finding>& out);
  void check_starts(const Fit& now, std::vector<Finding>& out) const;
  std::string joint_noise(const Fit& now) const;

  const DoctorOptions& options_;
  Rig rig_;              // with mistakes undone that were found
  bool chosen_ = false;  // the rig has no steps: these are ours
  Samples samples_;
  std::vector<Stage> steps_;
  Stage all_;  // what the steps free together
};

void Doctor::plan() {
  if (rig_.steps.empty()) {  // who says nothing does not know where things are
    Step step;
    step.name = "poses";
    for (size_t s = 0; s < rig_.sensors.size(); ++s) step.sensors.push_back(static_cast<int>(s));
    step.free = {"sensor/*/pose"};
    if (std::any_of(rig_.targets.begin(), rig_.targets.end(), [](const Target& t) { return t.link >= 0; }))
      step.free.push_back("target/*/pose");
    rig_.steps = {step};
    step.name = "offsets";
    step.free.push_back("joint/*/offset");
    step.priors.push_back({"joint/*/offset", 0.05, 0.05, false, "joint/*/offset"});
    try {
      Rig more = rig_;
      more.steps.push_back(step);
      check_steps(Recording(more, samples_));
      rig_.steps = more.steps;
    } catch (const std::invalid_argument&) {  // no joint has a say
    }
    chosen_ = true;
  }
  const Recording recording(rig_, samples_);
  check_steps(recording);
  const std::vector<StepPlan> plans = resolve_steps(recording, {});
  const ParameterTable& table = recording.table;
  std::set<int> sensors;
  std::vector<Freed> together;
  std::map<std::pair<int, int>, double> priors;
  for (size_t i = 0; i < plans.size(); ++i) {
    Stage stage;
    stage.sensors = rig_.steps[i].sensors;
    stage.loss = rig_.steps[i].loss.value_or(Loss());
    for (const Freed& f : plans[i].free)
      for (int c : f.components) {
        stage.free.push_back(table.all[f.parameter].component_name(c));
        priors.erase({f.parameter, c});
      }
    for (const Prior& p : plans[i].priors) {
      stage.priors.push_back({table.all[p.parameter].component_name(p.component), p.sigma});
      priors[{p.parameter, p.component}] = p.sigma;
    }
    merge(together, plans[i].free);
    sensors.insert(stage.sensors.begin(), stage.sensors.end());
    all_.loss = stage.loss;
    steps_.push_back(std::move(stage));
  }
  all_.sensors.assign(sensors.begin(), sensors.end());
  for (const Freed& f : together)
    for (int c : f.components) all_.free.push_back(table.all[f.parameter].component_name(c));
  for (const auto& p : priors) all_.priors.push_back({table.all[p.first.first].component_name(p.first.second), p.second});
  for (Sample& s : samples_)  // what no step uses is not judged
    s.views.erase(std::remove_if(s.views.begin(), s.views.end(), [&](const View& v) { return !sensors.count(v.sensor); }), s.views.end());
}

Fit Doctor::fit(const Rig& rig, const Samples& samples, const std::vector<Stage>& stages, const FitOptions& o) const {
  Fit out;
  const Recording recording(rig, samples);
  const ParameterTable& table = recording.table;
  VectorXd initial = table.initial;
  out.given = initial;
  Values values;
  std::vector<int> all(samples.size());
  std::iota(all.begin(), all.end(), 0);
  std::vector<std::vector<Freed>> free(stages.size());
  std::vector<char> whole(table.all.size(), 0), prior(table.all.size(), 0);
  for (size_t i = 0; i < stages.size(); ++i) {
    for (const std::string& name : stages[i].free) merge(free[i], table.select(name));
    for (const Freed& f : free[i]) whole[f.parameter] = whole[f.parameter] || f.whole(table.all[f.parameter]);
    for (const auto& p : stages[i].priors) prior[table.select(p.first).at(0).parameter] = 1;
  }
  std::set<int> absent;  // poses that the rig does not give: they cannot have moved from it
  for (size_t k = 0; k < rig.sensors.size(); ++k)
    if (!rig.sensors[k].pose_given) absent.insert(table.sensor_pose[k]);
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (rig.targets[t].link >= 0 && !rig.targets[t].pose_given) absent.insert(table.target_pose[t]);
  if (o.start) {
    values = *o.start;
  } else {
    values.shared = table.initial;
    std::vector<int> unknown;
    const auto add = [&](int p, bool given) {
      if (whole[p] && !prior[p] && (o.closed_form || !given)) unknown.push_back(p);
    };
    for (size_t s = 0; s < rig.sensors.size(); ++s) add(table.sensor_pose[s], rig.sensors[s].pose_given);
    for (size_t t = 0; t < rig.targets.size(); ++t)
      if (rig.targets[t].link >= 0) add(table.target_pose[t], rig.targets[t].pose_given);
    if (!unknown.empty()) {
      start_unknown_poses(recording, all, unknown, values);
      initial = values.shared;
    }
  }
  SolverOptions solver_options;
  solver_options.threads = options_.threads;
  solver_options.max_iterations = o.iterations;
  solver_options.relative_decrease = o.relative_decrease;
  bool gave_up = false;
  solver_options.progress = [&](int iteration, double chi2, double) {
    if (options_.progress && !options_.progress(-1, 0)) return false;
    gave_up = iteration >= 5 && chi2 > o.give_up;
    return !gave_up;
  };
  for (size_t i = 0; i < stages.size(); ++i) {
    const bool last = i + 1 == stages.size();
    EstimationSetup setup;
    setup.noise = options_.noise;
    setup.sensors = stages[i].sensors;
    setup.loss = o.loss.value_or(stages[i].loss);
    setup.free = free[i];
    setup.initial = initial;
    for (const auto& p : stages[i].priors) {
      const Freed f = table.select(p.first).at(0);
      setup.priors.push_back({f.parameter, f.components[0], p.second});
    }
    std::vector<int> there, undefined;
    for (int s : all) try {
        start_targets(recording, {s}, setup.sensors, setup.loss, values, o.refine);
        there.push_back(s);
      } catch (const std::runtime_error&) {
        undefined.push_back(s);
      }
    const auto undefined_groups = [&](Estimation& problem) {
      const VectorXd state = problem.pack(values);
      problem.renew(state);
      std::set<int> bad;
      Cost cost;
      for (size_t g = 0; g < problem.groups().size(); ++g)
        if (!problem.evaluate(static_cast<int>(g), state, 0, cost) || !std::isfinite(cost.twice))
          bad.insert(problem.sample_of(static_cast<int>(g)));
      return bad;
    };
    {
      Estimation trial(recording, there, setup);
      const std::set<int> bad = undefined_groups(trial);
      if (!bad.empty()) {
        there.erase(std::remove_if(there.begin(), there.end(), [&](int s) { return bad.count(s) > 0; }), there.end());
        undefined.insert(undefined.end(), bad.begin(), bad.end());
      }
      std::sort(undefined.begin(), undefined.end());
    }
    Estimation problem(recording, there, setup);
    if (last) out.undefined = undefined;
    if (problem.empty()) continue;
    VectorXd state = problem.pack(values);
    LevenbergMarquardt solver(problem, solver_options);
    const SolveSummary& summary = solver.solve(state);
    if (summary.outcome == Outcome::cancelled && !gave_up) throw Cancelled();
    problem.unpack(state, values);
    if (!last) continue;
    problem.renew(state);
    out.chi2 = summary.cost.chi2;
    out.cost = summary.cost.twice;
    out.dof = -problem.shared_size();
    if (gave_up) {
      out.chi2 = kInfinity;
      return out;
    }
    out.sample.assign(samples.size(), std::nan(""));
    std::vector<double> excess(samples.size(), 1);  // rows minus private unknowns
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
    out.most = out.sample;
    std::map<int, std::pair<double, long>> sums;
    for (const ViewResiduals& r : problem.residuals(state)) {
      const SensorModel& model = *rig.sensors[r.view->sensor].model;
      const Eigen::Index points = model.whole_pose() ? 1 : r.raw.size() / model.rows(), rows = r.whitened.size() / points;
      std::vector<double> squares;
      for (Eigen::Index k = 0; k < points; ++k) squares.push_back(r.whitened.segment(k * rows, rows).squaredNorm());
      std::sort(squares.begin(), squares.end());
      const size_t kept = squares.size() == 1 ? 1 : squares.size() - (squares.size() + 9) / 10;
      const double worst = std::accumulate(squares.begin() + static_cast<std::ptrdiff_t>(kept), squares.end(), 0.0);
      out.most[r.sample] -= worst / excess[r.sample];
      sums[r.view->sensor].first += r.whitened.squaredNorm();
      sums[r.view->sensor].second += r.whitened.size();
    }
    for (const auto& sum : sums) out.sensor[sum.first] = sum.second.first / static_cast<double>(sum.second.second);
    for (const Freed& f : free[i]) {
      const Parameter& p = table.all[f.parameter];
      double& moved = out.moved[p.name];
      if (absent.count(f.parameter)) continue;
      if (p.pose) {
        const Pose change = inverse(get_pose(out.given, p.start)) * get_pose(values.shared, p.start);
        moved = std::max(change.translation.norm(), log_so3(change.rotation).norm());
        continue;
      }
      for (int c : f.components) {
        const double given = out.given(p.start + c), change = std::abs(values.shared(p.start + c) - given);
        const bool scale = std::count(table.joint_scale.begin(), table.joint_scale.end(), f.parameter) > 0;  // -1 hides a sign
        const bool length = scale || p.components[c] == "fx" || p.components[c] == "fy" || (p.units[c] == "m" && given != 0);
        if (length || p.units[c] == "rad") moved = std::max(moved, length ? change / std::abs(given) : change);
      }
    }
  }
  out.values = std::move(values);
  return out;
}

bool Doctor::open_poses() const {
  const ParameterTable table(rig_);
  const FreedNames freed = freed_names(table);
  for (size_t s = 0; s < rig_.sensors.size(); ++s)
    if (rig_.sensors[s].pose_given && freed.whole[table.sensor_pose[s]]) return true;
  for (size_t t = 0; t < rig_.targets.size(); ++t)
    if (rig_.targets[t].link >= 0 && rig_.targets[t].pose_given && freed.whole[table.target_pose[t]]) return true;
  return false;
}

FreedNames Doctor::freed_names(const ParameterTable& table) const {
  FreedNames out;
  out.parameter.assign(table.all.size(), 0);
  out.whole.assign(table.all.size(), 0);
  std::vector<Freed> free;
  for (const std::string& name : all_.free) merge(free, table.select(name));
  for (const Freed& f : free) out.parameter[f.parameter] = 1, out.whole[f.parameter] = f.whole(table.all[f.parameter]);
  return out;
}

bool Doctor::good(const Fit& f) const {
  if (!(f.per_dof() < kGood)) return false;
  return std::none_of(f.sensor.begin(), f.sensor.end(), [](double s) { return s > kGood; });
}

/// The rig's values, or closed form where these do not lead anywhere.
Fit Doctor::best_fit(const Rig& rig, const Samples& samples, const Stage& stage, int iterations, double decrease, bool new_poses,
                     double give_up) const {
  FitOptions o;
  o.give_up = give_up;
  o.refine = decrease < 1e-3;
  o.iterations = iterations;
  o.relative_decrease = decrease;
  Fit out = fit(rig, samples, {stage}, o);
  if ((new_poses || !(out.per_dof() < kNoise)) && open_poses()) {
    o.closed_form = true;
    Fit other = fit(rig, samples, {stage}, o);
    if (other.score() < out.score() || other.undefined.size() < out.undefined.size()) out = std::move(other);
  }
  return out;
}

/// Enough of them for a first look: every pair of sensor and target some times, and several times as many numbers as unknowns.
Samples Doctor::some_samples() const {
  std::vector<int> order(samples_.size());
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [&](int a, int b) { return samples_[a].id < samples_[b].id; });
  std::map<std::pair<int, int>, std::vector<int>> by_pair;
  for (int i : order)
    for (const View& v : samples_[i].views) {
      std::vector<int>& list = by_pair[{v.sensor, v.target}];
      if (list.empty() || list.back() != i) list.push_back(i);
    }
  for (size_t each = 4;; each *= 2) {
    std::set<int> chosen;
    for (const auto& pair : by_pair) {
      const size_t count = pair.second.size(), take = std::min(each, count);
      size_t there = 0;
      for (int i : pair.second) there += chosen.count(i);
      for (size_t k = there; k < take; ++k) chosen.insert(pair.second[k * count / take]);
    }
    size_t rows = 0;
    for (int i : chosen)
      for (const View& v : samples_[i].views)
        rows += rig_.sensors[v.sensor].model->rows() * (rig_.sensors[v.sensor].model->whole_pose() ? 1 : v.ids.size());
    if (rows < 8 * all_.free.size() && chosen.size() < samples_.size()) continue;
    Samples out;
    for (int i : chosen) out.push_back(samples_[i]);
    return out;
  }
}

Fit Doctor::as_is() const {
  Fit out = best_fit(rig_, samples_, all_, 60, 1e-7, false);
  if (good(out) || steps_.size() < 2) return out;
  std::vector<Stage> stages = steps_;
  stages.push_back(all_);
  FitOptions o;
  o.iterations = 30;
  o.relative_decrease = 1e-6;
  Fit other = fit(rig_, samples_, stages, o);
  return other.score() < out.score() || other.undefined.size() < out.undefined.size() ? other : out;
}

bool Doctor::believed(const Fit& before, const Fit& now, double now_cost, bool strict) const {
  const double per_dof = now.per_dof();
  if (!before.complete()) return per_dof < kOverwhelming;
  if (per_dof < kClean && !strict) {
    double worst = 0;  // a sensor's share of all may be small
    for (size_t s = 0; s < before.sensor.size(); ++s)
      if (before.sensor[s] > kGood) worst = std::max(worst, before.sensor[s] / now.sensor[s]);
    return before.cost > kEnough * now_cost || (worst > kDecisive && before.cost > now_cost);
  }
  return before.cost > (per_dof < kNoise ? kDecisive : kOverwhelming) * now_cost;
}

// ------------------------------------------------------------------------------------------------ bad samples, turned views
/// Losses with a scale from the data, lowered step by step, so that a minority of wrong samples has no say.
Fit Doctor::robust_fit() const {
  FitOptions o;
  o.iterations = 15;
  o.relative_decrease = 1e-3;
  Fit now;
  double scale = 0;
  for (bool closed_form : {false, true}) {
    if (closed_form && !open_poses()) break;
    // Residuals at the start: what the median sample has.
    FitOptions start = o;
    start.iterations = 0;
    start.closed_form = closed_form;
    Fit trial = fit(rig_, samples_, {all_}, start);
    const double typical = std::sqrt(median_of_finite(trial.sample));
    if (std::isnan(typical) || (scale > 0 && typical > scale)) continue;
    scale = typical;
    now = std::move(trial);
  }
  if (!(scale > 0)) return now;
  for (int i = 0; i < 12; ++i) {
    o.loss = Loss{LossKind::cauchy, std::max(3.0, 2 * scale)};
    const Values start = now.values;
    o.start = &start;
    now = fit(rig_, samples_, {all_}, o);
    const double typical = std::sqrt(median_of_finite(now.sample));
    if (std::isnan(typical)) break;
    const bool settled = typical > 0.8 * scale;
    scale = typical;
    if (settled) break;
  }
  return now;
}

std::optional<Hypothesis> Doctor::bad_samples(const Fit& robust) const {
  if (samples_.size() < 4 || robust.sample.empty()) return std::nullopt;
  const double typical = median_of_finite(robust.sample);
  if (!std::isfinite(typical)) return std::nullopt;
  const double limit = kSampleExcess * std::max(1.0, typical);
  std::set<std::string> bad;
  for (size_t i = 0; i < samples_.size(); ++i)
    if ((robust.sample[i] > limit && robust.most[i] > 0.2 * kSampleExcess) ||
        std::count(robust.undefined.begin(), robust.undefined.end(), static_cast<int>(i)))
      bad.insert(samples_[i].id);
  if (bad.empty() || bad.size() > kMostBad * samples_.size()) return std::nullopt;
  // A fit without a sample may do without it what it cannot do with it: samples that the others can live with come back.
  std::vector<std::pair<double, int>> order;
  for (size_t i = 0; i < samples_.size(); ++i)
    if (bad.count(samples_[i].id)) order.push_back({std::isfinite(robust.sample[i]) ? robust.sample[i] : kInfinity, static_cast<int>(i)});
  std::sort(order.begin(), order.end());
  const auto without_bad = [&](double give_up) {
    Samples rest = samples_;
    for (Sample& s : rest)
      if (bad.count(s.id)) s.views.clear();
    FitOptions o;
    o.iterations = 40;
    o.relative_decrease = 1e-3;
    o.start = &robust.values;
    o.give_up = give_up;
    return fit(rig_, rest, {all_}, o);
  };
  const Fit rest = without_bad(kInfinity);
  double per_dof = rest.per_dof();
  int refused = 0;
  for (size_t i = 0; i < order.size() && refused < 3; ++i) {
    const std::string& id = samples_[order[i].second].id;
    bad.erase(id);
    const Fit with = without_bad(4 * std::max(1.0, per_dof) * static_cast<double>(rest.dof));
    if (with.per_dof() < 2 * std::max(1.0, per_dof) && with.sample[order[i].second] < kSampleExcess * std::max(1.0, per_dof)) {
      per_dof = with.per_dof();
    } else {
      bad.insert(id);
      ++refused;
    }
  }
  if (bad.empty()) return std::nullopt;
  for (size_t s = 0; s < rig_.sensors.size(); ++s) {  // all that a sensor sees: something is wrong with that sensor or with what it sees
    bool seen = false, left = false;
    for (const Sample& sample : samples_)
      for (const View& v : sample.views)
        if (v.sensor == static_cast<int>(s)) seen = true, left = left || !bad.count(sample.id);
    if (seen && !left) return std::nullopt;
  }
  Hypothesis h;
  h.id = "bad-samples";
  h.where.assign(bad.begin(), bad.end());
  h.what = (bad.size() == 1 ? "the joint readings of sample " : "the joint readings of samples ") + joined(h.where) + " do not belong to " +
           (bad.size() == 1 ? "its" : "their") + " views";
  h.cure = bad.size() == 1 ? "Leave it out, or find its readings." : "Leave them out, or find their readings.";
  h.undo = [bad](Rig&, Samples& samples) {
    samples.erase(std::remove_if(samples.begin(), samples.end(), [&](const Sample& s) { return bad.count(s.id) > 0; }), samples.end());
  };
  return h;
}

/// Half a turn of single views of a grid: those that it makes fit far better while everything shared stays.
std::vector<Hypothesis> Doctor::turned_views(const Fit& robust) const {
  if (!(median_of_finite(robust.sample) < kSampleExcess)) return {};  // most samples fit nothing: there is no consensus to ask
  const ParameterTable table(rig_);
  std::vector<int> sensors(rig_.sensors.size());
  std::iota(sensors.begin(), sensors.end(), 0);
  const Eigen::Matrix2d half = -Eigen::Matrix2d::Identity();
  if (robust.values.shared.size() != table.initial.size()) return {};
  EstimationSetup setup;
  setup.noise = NoiseMode::none;
  setup.sensors = sensors;
  setup.loss = {LossKind::soft_l1, 3};
  Recording one(rig_, {});
  const auto cost_of = [&](const Sample& sample) {
    one.samples = {sample};
    Values values;
    values.shared = robust.values.shared;
    try {
      start_targets(one, {0}, sensors, setup.loss, values);
    } catch (const std::runtime_error&) {
      return kInfinity;
    }
    Estimation problem(one, {0}, setup);
    const VectorXd state = problem.pack(values);
    problem.renew(state);
    Cost cost;
    return !problem.empty() && problem.evaluate(0, state, 0, cost) && std::isfinite(cost.twice) ? cost.twice : kInfinity;
  };
  std::set<std::pair<std::string, int>> turned;  // sample, place of the view
  std::set<std::string> where;
  size_t views = 0;
  for (const Sample& sample : samples_) {
    std::vector<std::vector<int>> sets;  // of views: each alone, all of a target
    std::map<int, std::vector<int>> by_target;
    for (size_t v = 0; v < sample.views.size(); ++v) {
      const View& view = sample.views[v];
      if (rig_.sensors[view.sensor].model->whole_pose() || relabeling(rig_.targets[view.target], half).empty()) continue;
      ++views;
      sets.push_back({static_cast<int>(v)});
      by_target[view.target].push_back(static_cast<int>(v));
    }
    for (const auto& t : by_target)
      if (t.second.size() > 1) sets.push_back(t.second);
    if (sets.empty()) continue;
    double least = cost_of(sample);
    if (least < 50) continue;
    least /= kDecisive;
    std::vector<int> best;
    for (const std::vector<int>& set : sets) {
      Sample trial = sample;
      for (int v : set) relabel(trial.views[v], rig_.targets[trial.views[v].target], relabeling(rig_.targets[trial.views[v].target], half));
      const double cost = cost_of(trial);
      if (cost < least) least = cost, best = set;
    }
    for (int v : best) turned.insert({sample.id, v}), where.insert(sample.id);
  }
  if (turned.empty() || turned.size() == views) return {};
  std::set<std::string> names;
  for (const Sample& sample : samples_)
    for (size_t v = 0; v < sample.views.size(); ++v)
      if (turned.count({sample.id, static_cast<int>(v)})) names.insert(rig_.sensors[sample.views[v].sensor].name);
  Hypothesis h;
  h.id = "numbering";
  h.where.assign(names.begin(), names.end());
  h.where.insert(h.where.end(), where.begin(), where.end());
  h.what = std::to_string(turned.size()) + (turned.size() == 1 ? " view of " : " views of ") + joined({names.begin(), names.end()}) +
           (turned.size() == 1 ? " numbers its board" : " number their boards") + " from the opposite corner (half a turn): sample" +
           (where.size() > 1 ? "s " : " ") + joined({where.begin(), where.end()});
  h.cure = "Reverse the order of the points in these views.";
  h.undo = [turned](Rig& rig, Samples& samples) {
    for (Sample& sample : samples)
      for (size_t v = 0; v < sample.views.size(); ++v)
        if (turned.count({sample.id, static_cast<int>(v)})) {
          const Target& target = rig.targets[sample.views[v].target];
          relabel(sample.views[v], target, relabeling(target, -Eigen::Matrix2d::Identity()));
        }
  };
  return {h};
}

// ------------------------------------------------------------------------------------------------ hypotheses
/// Tests all mistakes, undoes the one that explains most, and says so; false if none is believed. `by_movement`: what it explains is not chi2
/// but that the estimate is far from the rig's values.
bool Doctor::explain(Fit& now, bool by_movement, std::vector<Finding>& out) {
  const ParameterTable table(rig_);
  std::vector<Hypothesis> all = hypotheses(rig_, table, samples_, freed_names(table));
  if (by_movement)
    all.erase(std::remove_if(all.begin(), all.end(), [](const Hypothesis& h) { return h.marked || !h.squares.empty() || !h.free.empty(); }),
              all.end());
  const size_t common = all.size();
  if (!by_movement) {
    const Fit robust = robust_fit();
    for (Hypothesis& h : turned_views(robust)) all.push_back(std::move(h));
    if (auto h = bad_samples(robust)) all.push_back(std::move(*h));
  }

  struct Trial {
    Rig rig;
    Samples samples;
    Stage stage;
    Fit fit;
    double cost;  // for comparison
  };
  const auto test = [&](const Hypothesis& h, const Samples& samples, int iterations, double decrease, double give_up) {
    Trial t{rig_, samples, all_, {}, kInfinity};
    h.undo(t.rig, t.samples);
    t.stage.free.insert(t.stage.free.end(), h.free.begin(), h.free.end());
    for (int square : h.squares) t.stage.free.push_back("target/" + rig_.targets[square].name + "/square");
    if (h.excused >= 0) t.rig.joints[h.excused].sigma = 1;
    try {
      t.fit = best_fit(t.rig, t.samples, t.stage, iterations, decrease, h.new_poses, give_up);
      t.cost = t.fit.score();
    } catch (const std::invalid_argument&) {  // a way that cannot be walked in the other rig
    }
    if (h.id == "bad-samples") t.cost *= kWorth * static_cast<double>(now.dof) / static_cast<double>(std::max(1L, t.fit.dof));
    return t;
  };
  // By what factors the sizes are to be changed; empty if that is not sane: nothing, everything shrunk to a point, each by another factor.
  const auto size_factors = [&](const Hypothesis& h, const Trial& t) {
    std::vector<double> factors;
    const ParameterTable fitted(t.rig);
    for (int s : h.squares)
      factors.push_back(std::abs(t.fit.values.shared(fitted.all[fitted.target_square[s]].start)) /  // negative: the board half a turn round
                        (rig_.targets[s].grid ? rig_.targets[s].square : 1));
    const double low = *std::min_element(factors.begin(), factors.end()), high = *std::max_element(factors.begin(), factors.end());
    const bool sane = low > 1e-4 && high < 1e4 && high < 1.1 * low && std::max(std::abs(low - 1), std::abs(high - 1)) > 0.005;
    return sane ? factors : std::vector<double>();
  };
  const auto convinces = [&](const Hypothesis& h, const Trial& t) {
    if (by_movement) return t.cost < 1.3 * now.cost && nearer(now, t.fit) > 0;
    if (!h.squares.empty() && size_factors(h, t).empty()) return false;
    const bool strict = h.id == "bad-samples" || h.excused >= 0;
    return believed(now, t.fit, h.id == "bad-samples" ? t.cost / kWorth : t.cost, strict);
  };
  const auto extras = [](const Hypothesis& h) { return h.squares.size() + h.free.size(); };
  std::optional<Trial> best;
  size_t chosen = 0;
  const auto try_whole = [&](size_t i) {
    Trial t = test(all[i], samples_, 100, 1e-9, best && !by_movement ? 20 * best->cost : kInfinity);
    if (!std::isfinite(t.cost) || !convinces(all[i], t)) return;
    const bool equal = best && t.cost < 1.2 * best->cost && best->cost < 1.2 * t.cost;
    const size_t extra = extras(all[i]), fewest = extras(all[chosen]);
    if (!best || (equal ? extra < fewest || (extra == fewest && t.fit.farthest() < 0.5 * best->fit.farthest()) : t.cost < best->cost))
      best = std::move(t), chosen = i;
  };
  for (size_t i = common; i < all.size(); ++i) try_whole(i);
  // A few samples or views may be all that is wrong; if many go with it, something else may be wrong with these.
  if (!best || best->fit.per_dof() > kClean || static_cast<double>(best->fit.dof) < 0.9 * static_cast<double>(now.dof)) {
    const Samples some = some_samples();
    std::vector<std::pair<double, size_t>> order;
    double least = kInfinity;
    for (size_t i = 0; i < common; ++i) {
      step(static_cast<int>(i), static_cast<int>(common));
      const Trial t = test(all[i], some, 10, 1e-2, by_movement ? kInfinity : 20 * least);
      if (!std::isfinite(t.cost)) continue;
      least = std::min(least, t.cost);
      if (!by_movement)
        order.push_back({t.cost, i});
      else if (nearer(now, t.fit) > 0)
        order.push_back({t.fit.per_dof() / nearer(now, t.fit), i});
    }
    std::sort(order.begin(), order.end());
    if (order.size() > 4) order.resize(4);
    for (const auto& o : order) try_whole(o.second);
  }
  if (!best) return false;
  const Hypothesis& h = all[chosen];
  std::string evidence;
  std::optional<double> chi2_before, chi2_after;
  if (by_movement) {
    // With what moved far held at the rig's values; if others can take its place (a gear scale of -1, the axes around), with all held.
    std::string far;
    for (const auto& m : now.moved)
      if (m.second >= kFar && best->fit.moved.at(m.first) <= 0.2 * m.second) far += (far.empty() ? "" : ", ") + m.first;
    const auto hold = [&](Stage stage, bool everything) {
      for (const auto& m : now.moved) {
        if (!everything && (m.second < kFar || best->fit.moved.at(m.first) > 0.2 * m.second)) continue;
        const auto of_it = [&](const std::string& name) { return name == m.first || name.rfind(m.first + ".", 0) == 0; };
        stage.free.erase(std::remove_if(stage.free.begin(), stage.free.end(), of_it), stage.free.end());
        stage.priors.erase(std::remove_if(stage.priors.begin(), stage.priors.end(), [&](const auto& p) { return of_it(p.first); }),
                           stage.priors.end());
      }
      return stage;
    };
    const auto farthest_of = [&](const Fit& f) {
      double most = 0;
      for (const auto& m : now.moved)
        if (m.second >= kFar && best->fit.moved.at(m.first) <= 0.2 * m.second) most = std::max(most, f.moved.at(m.first));
      return most;
    };
    Fit before, after;
    bool decided = false, everything = false;
    for (bool all_held : {false, true}) {
      if (decided) break;
      everything = all_held;
      before = best_fit(rig_, samples_, hold(all_, all_held), 60, 1e-4, false);
      after = best_fit(best->rig, best->samples, hold(best->stage, all_held), 60, 1e-4, false);
      decided = after.complete() && (!before.complete() || before.cost > kDecisive * after.cost);
    }
    if (!decided) return false;
    if (before.complete()) chi2_before = before.chi2;
    chi2_after = after.chi2;
    evidence = "The estimate hides it by moving " + far +
               text(" by up to %.3g (m, rad, or share of a length); without this mistake %.3g are enough. ", farthest_of(now),
                    farthest_of(best->fit)) +
               (everything ? "With all held at the rig's values " : "With these held at the rig's values ") +
               (before.complete() ? text("chi2 is %.6g as it is", before.chi2) : "the fit cannot even start as it is") +
               text(" and %.6g without this mistake. ", after.chi2);
  } else {
    if (now.complete()) chi2_before = now.chi2;
    chi2_after = best->fit.chi2;
    evidence =
        now.complete()
            ? text("chi2 is %.6g as it is (chi2/dof %.3g) and %.6g (%.3g) without this mistake. ", now.chi2, now.per_dof(), best->fit.chi2,
                   best->fit.per_dof())
            : text("As it is the fit cannot even start (points behind a camera); without this mistake chi2 is %.6g (chi2/dof %.3g). ",
                   best->fit.chi2, best->fit.per_dof());
  }
  Finding finding;
  finding.id = h.id;
  finding.where = h.where;
  std::string what = h.what, cure = h.cure;
  if (!h.squares.empty()) {
    const std::vector<double> factors = size_factors(h, *best);
    what.clear();
    for (size_t i = 0; i < factors.size(); ++i) {
      const Target& old = rig_.targets[h.squares[i]];
      best->rig.targets[h.squares[i]].square = (old.grid ? old.square : 1) * factors[i];
      what += what.empty() ? "" : "; ";
      what += old.grid ? "the size of target '" + old.name + "' is wrong: " +
                             text("the rig says %.6g m, the data say %.6g m (times %.5g)", old.square, old.square * factors[i], factors[i])
                       : "the points of target '" + old.name +
                             "' have the wrong unit or scale: " + text("the data say %.5g times as large", factors[i]);
    }
    cure = "Measure, and correct the size in the rig: metres, from corner to corner.";
  }
  finding.chi2_as_is = chi2_before;
  finding.chi2_corrected = chi2_after;
  what[0] = static_cast<char>(std::toupper(what[0]));
  finding.text = what + ". " + evidence + cure;
  out.push_back(std::move(finding));
  rig_ = std::move(best->rig);
  samples_ = std::move(best->samples);
  all_ = std::move(best->stage);
  now = std::move(best->fit);
  return true;
}

// ------------------------------------------------------------------------------------------------ start values
/// Poses that the estimate left behind, but whose inverse is where the estimate ended.
void Doctor::check_starts(const Fit& now, std::vector<Finding>& out) const {
  const ParameterTable table(rig_);
  const FreedNames freed = freed_names(table);
  if (now.values.shared.size() != table.initial.size()) return;
  const auto check = [&](int parameter, const Pose& given, const std::string& name, const Pose& other, const std::string& what,
                         const std::string& cure) {
    if (!freed.parameter[parameter]) return;
    const Pose estimate = get_pose(now.values.shared, table.all[parameter].start);
    const auto away = [&](const Pose& p) {
      const Pose change = inverse(p) * estimate;
      return std::make_pair(change.translation.norm(), log_so3(change.rotation).norm());
    };
    const auto far = away(given), near = away(other);
    if (far.first < 0.05 && far.second < 0.7) return;
    if (near.first > std::max(0.005, 0.2 * far.first) || near.second > std::max(0.1, 0.2 * far.second)) return;
    // Held at the one and at the other, everything else free.
    const auto held_at = [&](const Pose& pose) {
      Rig rig = rig_;
      for (Sensor& s : rig.sensors)
        if (s.name == name && table.sensor_pose[&s - rig.sensors.data()] == parameter) s.link_T_sensor = pose, s.pose_given = true;
      for (Target& t : rig.targets)
        if (t.name == name && table.target_pose[&t - rig.targets.data()] == parameter) t.link_T_target = pose, t.pose_given = true;
      Stage stage = all_;
      const std::string prefix = table.all[parameter].name;
      stage.free.erase(
          std::remove_if(stage.free.begin(), stage.free.end(), [&](const std::string& n) { return n.rfind(prefix + ".", 0) == 0; }),
          stage.free.end());
      stage.priors.erase(
          std::remove_if(stage.priors.begin(), stage.priors.end(), [&](const auto& p) { return p.first.rfind(prefix + ".", 0) == 0; }),
          stage.priors.end());
      return best_fit(rig, samples_, stage, 60, 1e-4, false);
    };
    const Fit as_given = held_at(given), corrected = held_at(other);
    if (!corrected.complete() || (as_given.complete() && as_given.cost < kDecisive * corrected.cost)) return;
    Finding finding;
    finding.id = "inverted-pose";
    finding.where = {name};
    if (as_given.complete()) finding.chi2_as_is = as_given.chi2;
    finding.chi2_corrected = corrected.chi2;
    finding.text = what + text(": the estimate is %.3g m and %.3g degrees from the given pose", far.first, far.second * 180 / M_PI) +
                   text(", but only %.3g m and %.3g degrees from this. ", near.first, near.second * 180 / M_PI) +
                   "With the pose held, chi2 is " + (as_given.complete() ? text("%.6g as given", as_given.chi2) : "undefined as given") +
                   text(" and %.6g so. ", corrected.chi2) + cure;
    out.push_back(std::move(finding));
  };
  for (size_t s = 0; s < rig_.sensors.size(); ++s) {
    const Sensor& sensor = rig_.sensors[s];
    if (!sensor.pose_given || log_se3(sensor.link_T_sensor).norm() < 1e-6) continue;
    check(table.sensor_pose[s], sensor.link_T_sensor, sensor.name, inverse(sensor.link_T_sensor),
          "The pose of sensor '" + sensor.name + "' is given the wrong way round, as sensor_T_link",
          "Replace sensors." + sensor.name + ".pose by its inverse: it maps coordinates of the sensor to the link's.");
  }
  for (size_t t = 0; t < rig_.targets.size(); ++t) {
    const Target& target = rig_.targets[t];
    if (target.link < 0 || !target.pose_given) continue;
    const Pose& given = target.link_T_target;
    check(table.target_pose[t], given, target.name, inverse(given),
          "The pose of target '" + target.name + "' is given the wrong way round, as target_T_link",
          "Replace targets." + target.name + ".mount.pose by its inverse: it maps coordinates of the target to the link's.");
  }
}

/// How much noise of the joint readings would explain what is left; empty if it does not.
std::string Doctor::joint_noise(const Fit& now) const {
  if (options_.noise != NoiseMode::latent) return "";
  std::set<int> joints;
  for (const Sample& s : samples_)
    for (const View& v : s.views)
      for (int j : joints_between(rig_, v))
        if (rig_.sensors[v.sensor].scanning_joint != j) joints.insert(j);
  for (double sigma : {0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03}) {
    Rig rig = rig_;
    bool more = false;
    for (int j : joints)
      if (rig.joints[j].sigma < sigma) rig.joints[j].sigma = sigma, more = true;
    if (!more) continue;
    FitOptions o;
    o.iterations = 60;
    o.relative_decrease = 1e-4;
    o.start = &now.values;
    const Fit f = fit(rig, samples_, {all_}, o);
    if (f.per_dof() < kGood)
      return text(
          "Errors of the joint readings would: with sigma %.3g (rad, m) for every joint chi2/dof is %.3g. So the readings are that noisy "
          "(say so in the rig: joints), or the robot has another geometry than the rig can express.",
          sigma, f.per_dof());
  }
  return "";
}

// ------------------------------------------------------------------------------------------------ the data alone
void Doctor::check_still_joints(std::vector<Finding>& out) const {
  const ParameterTable table(rig_);
  const FreedNames freed = freed_names(table);
  std::map<int, std::pair<double, double>> range;
  std::map<int, std::set<int>> samples;
  for (size_t i = 0; i < samples_.size(); ++i)
    for (const View& v : samples_[i].views)
      for (int j : joints_between(rig_, v)) {
        const auto add = [&](double q) {
          const auto r = range.insert({j, {q, q}}).first;
          r->second = {std::min(r->second.first, q), std::max(r->second.second, q)};
        };
        samples[j].insert(static_cast<int>(i));
        if (rig_.sensors[v.sensor].scanning_joint != j)
          add(samples_[i].readings[j]);
        else
          for (size_t k = 0; k + 2 < v.z.size(); k += 3) add(v.z[k]);
      }
  for (const auto& r : range) {
    const int j = r.first;
    if (samples[j].size() < 2 || r.second.second - r.second.first > std::max(1e-6, 3 * rig_.joints[j].sigma)) continue;
    std::vector<std::string> names;
    if (table.joint_offset[j] >= 0 && freed.parameter[table.joint_offset[j]]) names.push_back(table.all[table.joint_offset[j]].name);
    if (table.joint_scale[j] >= 0 && freed.parameter[table.joint_scale[j]]) names.push_back(table.all[table.joint_scale[j]].name);
    if (freed.parameter[table.joint_origin[j]] && !freed.whole[table.joint_origin[j]])
      names.push_back(table.all[table.joint_origin[j]].name);
    if (names.empty()) continue;
    Finding f;
    f.id = "still-joint";
    f.where = {rig_.tree.joints[j].name};
    f.text = "Joint '" + rig_.tree.joints[j].name + "' never moves" + text(" (it reads %.6g in all ", r.second.first) +
             std::to_string(samples[j].size()) + " samples that need it), but the rig frees " + joined(names) +
             ". Take samples in which it moves, or hold " + (names.size() == 1 ? "it" : "them") + "; if it did move, the log is wrong.";
    out.push_back(std::move(f));
  }
}

void Doctor::check_connections(std::vector<Finding>& out) const {
  const Recording recording(rig_, samples_);
  const ParameterTable& table = recording.table;
  const FreedNames freed = freed_names(table);
  const int sensors = static_cast<int>(rig_.sensors.size()), nodes = sensors + static_cast<int>(rig_.targets.size());
  std::vector<int> parent(nodes), seen(nodes, 0);
  std::iota(parent.begin(), parent.end(), 0);
  const std::function<int(int)> root = [&](int i) { return parent[i] == i ? i : parent[i] = root(parent[i]); };
  for (const Sample& s : samples_) {
    std::map<int, int> hub;  // free target: a sensor that sees it in this sample
    for (const View& v : s.views) {
      seen[v.sensor] = 1;
      int other = sensors + v.target;
      if (rig_.targets[v.target].link < 0) other = hub.insert({v.target, v.sensor}).first->second;
      seen[other] = 1;
      parent[root(v.sensor)] = root(other);
    }
  }
  // A freed pose that no sample shows.
  const auto report = [&](const std::vector<std::string>& where, const std::string& what, const std::string& cure) {
    Finding f;
    f.id = "disconnected";
    f.where = where;
    f.text = what + " " + cure;
    out.push_back(std::move(f));
  };
  for (int s : all_.sensors)
    if (!seen[s] && freed.parameter[table.sensor_pose[s]])
      report({rig_.sensors[s].name}, "Sensor '" + rig_.sensors[s].name + "' has no view in any sample, but the rig frees its pose.",
             "Add views of it, or hold sensor/" + rig_.sensors[s].name + "/pose.");
  for (size_t t = 0; t < rig_.targets.size(); ++t)
    if (rig_.targets[t].link >= 0 && !seen[sensors + t] && freed.parameter[table.target_pose[t]])
      report({rig_.targets[t].name}, "Target '" + rig_.targets[t].name + "' is seen in no sample, but the rig frees its pose.",
             "Add views of it, or hold target/" + rig_.targets[t].name + "/pose.");

  const auto body = [&](int link) {
    while (rig_.tree.joint_above[link] >= 0 && !rig_.tree.joints[rig_.tree.joint_above[link]].moves())
      link = rig_.tree.joints[rig_.tree.joint_above[link]].parent;
    return link;
  };
  const auto influencing = [&](const std::function<bool(int)>& wanted) {
    EstimationSetup setup;
    setup.noise = NoiseMode::none;
    for (int s = 0; s < sensors; ++s)
      if (seen[s] && wanted(s)) setup.sensors.push_back(s);
    std::vector<int> all(samples_.size());
    std::iota(all.begin(), all.end(), 0);
    const Estimation probe(recording, all, setup);
    return probe.groups().empty() ? std::vector<char>(table.all.size(), 0) : probe.influencing();
  };
  std::map<int, std::vector<int>> components;
  for (int i = 0; i < nodes; ++i)
    if (seen[i]) components[root(i)].push_back(i);
  std::vector<char> places(table.all.size(), 0);  // parameters that say where something is
  for (const auto* list : {&table.joint_offset, &table.joint_scale, &table.joint_origin, &table.sensor_pose, &table.target_pose})
    for (int p : *list)
      if (p >= 0) places[p] = 1;
  for (const auto& component : components) {
    std::set<int> bodies;
    for (int i : component.second) bodies.insert(body(i < sensors ? rig_.sensors[i].link : rig_.targets[i - sensors].link));
    if (bodies.size() != 1) continue;
    const std::vector<char> here = influencing([&](int s) { return root(s) == component.first; });
    const std::vector<char> elsewhere = influencing([&](int s) { return root(s) != component.first; });
    bool anchor = false;
    std::vector<std::string> names, parameters;
    for (int i : component.second) {
      names.push_back(i < sensors ? rig_.sensors[i].name : rig_.targets[i - sensors].name);
      bool open = false;
      if (i < sensors) {
        const std::vector<char> own = influencing([&](int s) { return s == i; });
        for (size_t p = 0; p < table.all.size(); ++p) {
          const bool target = std::count(table.target_pose.begin(), table.target_pose.end(), static_cast<int>(p)) > 0;
          if (!own[p] || !here[p] || elsewhere[p] || !freed.parameter[p] || !places[p] || target) continue;
          open = true;
          if (!std::count(parameters.begin(), parameters.end(), table.all[p].name)) parameters.push_back(table.all[p].name);
        }
      } else if (freed.parameter[table.target_pose[i - sensors]]) {
        open = true;
        parameters.push_back(table.all[table.target_pose[i - sensors]].name);
      }
      anchor = anchor || !open;
    }
    if (anchor) continue;
    report(
        names,
        (names.size() == 1 ? "Sensor " : "") + joined(names) + (names.size() == 1 ? " is" : " are") +
            " tied to nothing else: no other sensor sees the same target in the same sample, and no mounted target is in view from another "
            "link, but the rig frees " +
            joined(parameters) + ".",
        "Take samples in which it and another sensor see one target, or hold these.");
  }
}

Diagnosis Doctor::run() {
  Diagnosis out;
  out.tested = {"square",        "rows-columns", "numbering",       "mirrored",  "joint-sign", "degrees",      "still-joint",
                "inverted-pose", "eye-in-hand",  "swapped-cameras", "rectified", "duplicates", "disconnected", "bad-samples"};
  std::vector<Finding> plain = find_duplicates(rig_, samples_), fitted;
  check_still_joints(plain);
  check_connections(plain);

  Fit now = as_is();
  if (now.complete()) out.chi2 = now.chi2;
  out.dof = now.dof;
  const double at_first = now.per_dof();
  // A joint whose log is a constant can look like many things: it goes first, and then nothing else can be told.
  bool still = false;
  for (Finding& f : plain) {
    if (f.id != "still-joint" || good(now)) continue;
    step(0, 1);
    Rig rig = rig_;
    rig.joints[rig.tree.find_joint(f.where[0])].sigma = 1;
    const Fit without = best_fit(rig, samples_, all_, 100, 1e-6, false);
    if (!without.complete() || (now.complete() && now.cost < kDecisive * without.cost)) continue;
    still = true;
    if (now.complete()) f.chi2_as_is = now.chi2;
    f.chi2_corrected = without.chi2;
    f.text += " It did move: " + (now.complete() ? text("chi2 is %.6g as it is", now.chi2) : "the fit cannot even start as it is") +
              text(" and %.6g with its readings unknown.", without.chi2);
  }
  for (int round = 0; round < kMostRounds && !good(now) && !still; ++round)
    if (!explain(now, false, fitted) || fitted.back().id == "still-joint") break;
  if (now.complete() && !still && (fitted.empty() || fitted.back().id != "still-joint")) {
    const size_t before = fitted.size();
    check_starts(now, fitted);
    for (int round = 0; round < kMostRounds && fitted.size() == before + round && now.farthest() > kFar; ++round)
      explain(now, true, fitted);
  }

  const std::string per_dof =
      std::isfinite(at_first) ? text("chi2/dof is %.3g", at_first) : "the fit cannot start: points lie behind a camera";
  if (good(now) && fitted.empty()) {
    out.verdict = per_dof + (plain.empty() ? ": nothing to explain." : ": the fit itself needs no explanation.");
  } else if (good(now)) {
    out.verdict = per_dof + ": what was found explains it" + text(" (%.3g without).", now.per_dof());
  } else {
    out.verdict =
        per_dof + (still            ? ": a joint that moved without its readings explains it."
                   : fitted.empty() ? ": none of these explains it."
                                    : text("; with what was found undone %.3g: none of the others explains that.", now.per_dof()));
    const std::string noise = now.complete() && !still && !chosen_ ? joint_noise(now) : "";
    if (!noise.empty()) out.verdict += " " + noise;
    if (chosen_)
      out.verdict +=
          " The rig has no estimate: only poses of sensors and targets and joint offsets were fitted here. calibrate tries more (the "
          "robot's "
          "geometry, gears, lenses): let it try before looking for mistakes.";
  }
  out.verdict[0] = out.verdict[0] == 't' ? 'T' : out.verdict[0];
  const auto ratio = [](const Finding& f) {
    return f.chi2_as_is && f.chi2_corrected ? *f.chi2_as_is / std::max(1e-300, *f.chi2_corrected) : kInfinity;
  };
  std::stable_sort(fitted.begin(), fitted.end(), [&](const Finding& a, const Finding& b) { return ratio(a) > ratio(b); });
  out.findings = std::move(fitted);
  for (Finding& f : plain)
    if (std::none_of(out.findings.begin(), out.findings.end(), [&](const Finding& g) { return g.id == f.id && g.where == f.where; }))
      out.findings.push_back(std::move(f));
  return out;
}

}  // namespace

std::vector<Finding> find_duplicates(const Rig& rig, const Samples& samples) {
  struct Key {
    std::vector<double> numbers;
    bool operator<(const Key& o) const { return numbers < o.numbers; }
  };
  std::map<Key, std::vector<std::string>> same;
  std::vector<const Key*> order;
  for (const Sample& s : samples) {
    Key key;
    bool measured = false;
    for (double q : s.readings) key.numbers.push_back(std::isnan(q) ? kInfinity : q);
    std::vector<std::vector<double>> views;
    for (const View& v : s.views) {
      std::vector<double> one = {static_cast<double>(v.sensor), static_cast<double>(v.target)};
      one.insert(one.end(), v.ids.begin(), v.ids.end());
      one.insert(one.end(), v.z.begin(), v.z.end());
      measured = measured || std::any_of(v.z.begin(), v.z.end(), [](double z) { return z != 0; });
      views.push_back(std::move(one));
    }
    if (!measured &&
        std::any_of(s.views.begin(), s.views.end(), [&](const View& v) { return rig.sensors[v.sensor].model->sight() == Sight::chain; }))
      continue;
    if (s.views.empty()) continue;
    std::sort(views.begin(), views.end());
    for (const auto& v : views) key.numbers.insert(key.numbers.end(), v.begin(), v.end());
    const auto found = same.insert({std::move(key), {}}).first;
    if (found->second.empty()) order.push_back(&found->first);
    found->second.push_back(s.id);
  }
  std::vector<Finding> out;
  for (const Key* key : order) {
    const std::vector<std::string>& ids = same[*key];
    if (ids.size() < 2) continue;
    Finding f;
    f.id = "duplicates";
    f.where = ids;
    f.text = "Samples " + joined(ids) + " are the same: joint readings and measured numbers. They count as " + std::to_string(ids.size()) +
             " measurements but are one; leave out all but one.";
    out.push_back(std::move(f));
  }
  return out;
}

std::optional<Diagnosis> diagnose(const Rig& rig, const Samples& samples, const DoctorOptions& options) {
  try {
    return Doctor(rig, samples, options).run();
  } catch (const Cancelled&) {
    return std::nullopt;
  }
}

}  // namespace kincal
