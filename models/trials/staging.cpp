#include "staging.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <set>
#include <stdexcept>

#include "../../solver/levenberg_marquardt.h"
#include "../../solver/observability.h"
#include "../calibration/calibration.h"
#include "../fitting/starts.h"
#include "../rig/numbers.h"
#include "../rig/selection.h"
#include "groups.h"

namespace kincal {
namespace {

constexpr int kFolds = 5, kFewestTargets = 3;
constexpr double kUnlikely = 2, kWorthwhile = 0.01;  // standard errors; share of the error
constexpr double kMissing = 1e12;  // chi2 a number of a held-out sample that cannot be evaluated

/// Everything that the search needs to know; the samples are sorted by id, so that their order in
/// the file does not matter.
class Search {
 public:
  Search(const Rig& rig, const std::vector<Sample>& samples, const StagingOptions& options);
  std::optional<Staging> run();

 private:
  struct Score {
    std::vector<double> relative;  // chi2 a number, by unit
    double error = kNan;
  };
  /// These are the samples of a fold, or the others.
  struct FoldSamples {
    std::vector<int> samples;
    std::vector<char> targets;  // by target: some sample sees it
  };
  void make_folds();
  void start();
  std::vector<Freed> freed(const std::vector<char>& kept) const;
  void drop_unobservable(Group& group, const std::vector<char>& kept, const VectorXd& shared);
  VectorXd reset(const VectorXd& shared, const std::vector<char>& kept) const;
  EstimationSetup held_setup() const;
  FoldSamples samples_of(int fold, bool inside) const;
  int target_of(const Freed& f) const;
  std::optional<Values> fit(const std::vector<char>& kept, const Values& from, int fold) const;
  void judge(const Values& values, int fold, std::vector<double>& chi2,
             std::vector<double>& count) const;
  Score score(const std::vector<char>& kept, const Values& from, bool fitted) const;
  bool better(const Score& before, const Score& after) const;
  std::vector<Step> explicit_steps(const std::vector<char>& kept,
                                   const std::vector<int>& order) const;

  Recording recording_;
  std::vector<Freed>
      of_held_out_;  // poses of targets that only held-out samples see, to be named with the others
  StagingOptions options_;
  const Rig& rig_ = recording_.rig;
  const ParameterTable& table_ = recording_.table;
  const std::vector<Sample>& samples_ = recording_.samples;
  VectorXd initial_ = table_.initial;  // with closed-form values of poses that the rig leaves open
  std::vector<Group> groups_;          // the mounts first
  std::vector<int> unit_, fold_of_unit_;  // by sample; by unit
  int folds_ = 0;
  bool by_target_ = false, absent_in_part_ = false;
  Values start_;
};

Search::Search(const Rig& rig, const std::vector<Sample>& samples, const StagingOptions& options)
    : recording_(staging_recording(rig, samples)), options_(options) {
  std::vector<char> seen(rig.targets.size(), 0);
  for (const Sample& s : samples_)
    for (const View& v : s.views) seen[v.target] = 1;
  for (const Sample& s : samples)
    for (const View& v : s.views)
      if (!s.train && !seen[v.target] && rig.targets[v.target].link >= 0)
        merge(of_held_out_, {whole(table_, table_.target_pose[v.target])});
  groups_ = make_groups(recording_);
}

void Search::make_folds() {
  // By target, where each sample sees one mounted target and some sensor sees several.
  std::vector<std::set<int>> by_sensor(rig_.sensors.size());
  std::set<int> targets;
  bool one_each = true;
  for (const Sample& s : samples_)
    for (const View& v : s.views) {
      by_sensor[v.sensor].insert(v.target);
      targets.insert(v.target);
      one_each = one_each && rig_.targets[v.target].link >= 0 && v.target == s.views[0].target;
    }
  size_t most = 0;
  for (const std::set<int>& t : by_sensor) most = std::max(most, t.size());
  by_target_ = one_each && most >= kFewestTargets;
  unit_.assign(samples_.size(), 0);
  if (by_target_) {
    const std::vector<int> list(targets.begin(), targets.end());
    for (size_t i = 0; i < samples_.size(); ++i)
      unit_[i] = static_cast<int>(std::find(list.begin(), list.end(), samples_[i].views[0].target) -
                                  list.begin());
    folds_ = std::min<int>(kFolds, static_cast<int>(list.size()));
    for (size_t u = 0; u < list.size(); ++u) fold_of_unit_.push_back(static_cast<int>(u) % folds_);
    return;
  }
  unit_ = indices(samples_.size());
  folds_ = std::min<int>(kFolds, static_cast<int>(samples_.size()));
  // Samples that see the same with the same sensors are dealt out in turn, so that each fold has
  // the same mixture.
  std::map<std::set<std::pair<int, int>>, std::vector<size_t>> alike;
  for (size_t i = 0; i < samples_.size(); ++i) {
    std::set<std::pair<int, int>> pairs;
    for (const View& v : samples_[i].views) pairs.insert({v.sensor, v.target});
    alike[pairs].push_back(i);
  }
  fold_of_unit_.assign(samples_.size(), 0);
  int next = 0;
  for (const auto& kind : alike)
    for (size_t i : kind.second) fold_of_unit_[i] = next++ % folds_;
}

/// Poses that the rig leaves open, in closed form; then all mounts fitted to all samples. What
/// nothing determines is taken out of them.
void Search::start() {
  Rig with_step = rig_;
  Step step;
  step.name = "mounts";
  step.sensors = indices(rig_.sensors.size());
  step.free = names_of(table_, groups_[0].free);
  if (step.free.empty()) return;
  with_step.steps = {step};
  const std::shared_ptr<const Recording> recording = make_recording(with_step, samples_);
  CalibrationOptions options;
  options.noise = options_.noise;
  options.threads = options_.threads;
  const Solution solution = calibrate(recording, options);
  if (solution.status == Status::undefined_start) throw std::runtime_error(solution.message);
  start_ = solution.values;
  initial_ = solution.initial;
  const std::vector<Freed> before = groups_[0].free;
  drop_unobservable(groups_[0], std::vector<char>(groups_.size(), 0), start_.shared);
  // Held components stand as they start: in the rig, or in closed form.
  start_.shared = reset(start_.shared, std::vector<char>(groups_.size(), 1));
  for (const Freed& f : without(before, groups_[0].free)) {
    const std::string& name = table_.all[f.parameter].name;
    absent_in_part_ = absent_in_part_ || std::count(solution.computed_starts.begin(),
                                                    solution.computed_starts.end(), name);
  }
}

/// What is freed with these groups: offsets of joints whose geometry is free are contained in it.
std::vector<Freed> Search::freed(const std::vector<char>& kept) const {
  std::vector<Freed> out;
  std::set<int> contained;
  for (size_t g = 0; g < groups_.size(); ++g)
    if (kept[g])
      contained.insert(groups_[g].contained_offsets.begin(), groups_[g].contained_offsets.end());
  for (size_t g = 0; g < groups_.size(); ++g)
    if (kept[g])
      for (const Freed& f : groups_[g].free)
        if (!contained.count(f.parameter)) merge(out, {f});
  return out;
}

/// Takes out of `group` what the data do not determine beside what is kept, priors aside: of each
/// direction the component with the largest coefficient.
void Search::drop_unobservable(Group& group, const std::vector<char>& kept,
                               const VectorXd& shared) {
  for (int round = 0; round < 10 && !group.free.empty(); ++round) {
    EstimationSetup setup = held_setup();
    setup.free = freed(kept);
    if (!group.contained_offsets.empty()) {
      std::vector<Freed> offsets;
      for (int p : group.contained_offsets) offsets.push_back(whole(table_, p));
      setup.free = without(setup.free, offsets);
    }
    setup.free = without(setup.free, group.free);
    merge(setup.free, group.free);
    Estimation problem(recording_, indices(samples_.size()), setup);
    Values values = start_;
    values.shared = shared;
    VectorXd state = problem.pack(values);
    problem.set_workers(1);
    problem.prepare(state);
    problem.renew(state);
    std::vector<Freed> drop;
    for (const auto& direction : observe(problem, state).directions) {
      const std::pair<int, double>* largest = nullptr;
      for (const auto& c : direction) {
        const auto& column = problem.columns()[c.first];
        if (has(group.free, column.parameter, column.index) &&
            (!largest || std::abs(c.second) > 1.001 * std::abs(largest->second)))
          largest = &c;
      }
      if (largest)
        merge(drop, {{problem.columns()[largest->first].parameter,
                      {problem.columns()[largest->first].index}}});
    }
    if (drop.empty()) return;
    group.free = without(group.free, drop);
    group.priors.erase(
        std::remove_if(group.priors.begin(), group.priors.end(),
                       [&](const Prior& p) { return has(drop, p.parameter, p.component); }),
        group.priors.end());
  }
}

/// Values with everything that is not kept as the rig has it; offsets that geometry contains stay.
VectorXd Search::reset(const VectorXd& shared, const std::vector<char>& kept) const {
  std::vector<Freed> free;
  for (size_t g = 0; g < groups_.size(); ++g)
    if (kept[g]) merge(free, groups_[g].free);
  VectorXd out = initial_;
  for (const Freed& f : free) {
    const Parameter& p = table_.all[f.parameter];
    if (f.whole(p)) {
      out.segment(p.start, p.pose ? 12 : p.size()) =
          shared.segment(p.start, p.pose ? 12 : p.size());
    } else if (p.pose) {
      const Pose initial = get_pose(initial_, p.start);
      const Vector6d xi = log_se3(inverse(initial) * get_pose(shared, p.start));
      Vector6d left = Vector6d::Zero();
      for (int c : f.components) left(c) = xi(c);
      set_pose(out, p.start, initial * exp_se3(left));
    } else {
      for (int c : f.components) out(p.start + c) = shared(p.start + c);
    }
  }
  return out;
}

/// The setup of every fit of the search, with everything held.
EstimationSetup Search::held_setup() const {
  EstimationSetup setup;
  setup.initial = initial_;
  setup.noise = options_.noise;
  setup.sensors = indices(rig_.sensors.size());
  return setup;
}

/// The samples inside of a fold, or outside (of fold -1: all).
Search::FoldSamples Search::samples_of(int fold, bool inside) const {
  FoldSamples out{{}, std::vector<char>(rig_.targets.size(), 0)};
  for (size_t i = 0; i < samples_.size(); ++i) {
    const bool in_fold = fold >= 0 && fold_of_unit_[unit_[i]] == fold;
    if (in_fold != inside) continue;
    out.samples.push_back(static_cast<int>(i));
    for (const View& v : samples_[i].views) out.targets[v.target] = 1;
  }
  return out;
}

/// The target whose pose this is; -1: it is none.
int Search::target_of(const Freed& f) const {
  const Parameter& p = table_.all[f.parameter];
  return p.kind == ParameterKind::target_pose ? p.owner : -1;
}

/// Fitted to all samples but those of a fold (-1: to all). nullopt: cannot be evaluated.
std::optional<Values> Search::fit(const std::vector<char>& kept, const Values& from,
                                  int fold) const {
  const FoldSamples part = samples_of(fold, false);
  const std::vector<int>& samples = part.samples;
  EstimationSetup setup = held_setup();
  for (const Freed& f : freed(kept))
    if (target_of(f) < 0 || part.targets[target_of(f)]) setup.free.push_back(f);
  for (size_t g = 0; g < groups_.size(); ++g)
    if (kept[g])
      for (const Prior& p : groups_[g].priors)
        if (has(setup.free, p.parameter, p.component)) setup.priors.push_back(p);
  Estimation problem(recording_, samples, setup);
  Values values = from;
  try {
    start_targets(recording_, samples, setup.sensors, Loss(), values);
  } catch (const std::runtime_error&) {
    return std::nullopt;
  }
  VectorXd state = problem.pack(values);
  SolverOptions solver;
  solver.threads = options_.threads;
  solver.max_iterations = 60;
  solver.relative_decrease = 1e-7;
  if (LevenbergMarquardt(problem, solver).solve(state).outcome == Outcome::undefined_start)
    return std::nullopt;
  problem.unpack(state, values);
  return values;
}

/// chi2 and numbers of a fold's units at given shared values.
void Search::judge(const Values& values, int fold, std::vector<double>& chi2,
                   std::vector<double>& count) const {
  FoldSamples part = samples_of(fold, true);
  std::vector<int>& samples = part.samples;
  EstimationSetup setup = held_setup();
  if (by_target_)
    for (const Freed& f : groups_[0].free)
      if (target_of(f) >= 0 && part.targets[target_of(f)]) setup.free.push_back(f);
  const auto numbers = [&](int sample) {
    double n = 0;
    for (const View& v : samples_[sample].views) {
      const SensorModel& model = *rig_.sensors[v.sensor].model;
      n += model.measures_pose() ? 6.0
                                 : static_cast<double>(model.rows()) *
                                       (v.ids.empty() ? 1.0 : static_cast<double>(v.ids.size()));
    }
    return n;
  };
  const auto missing = [&](int sample) {
    chi2[unit_[sample]] += kMissing * numbers(sample);
    count[unit_[sample]] += numbers(sample);
  };
  while (!samples.empty()) {
    Values local = values;
    std::vector<int> defined;
    for (int i : samples) {
      try {
        start_targets(recording_, {i}, setup.sensors, Loss(), local);
        defined.push_back(i);
      } catch (const std::runtime_error&) {
        missing(i);
      }
    }
    if (defined.empty()) return;
    Estimation problem(recording_, defined, setup);
    VectorXd state = problem.pack(local);
    SolverOptions solver;
    solver.threads = options_.threads;
    solver.max_iterations = 60;
    solver.relative_decrease = 1e-7;
    LevenbergMarquardt levenberg(problem, solver);
    const SolveSummary& summary = levenberg.solve(state);
    if (summary.outcome == Outcome::undefined_start) {
      const int bad = problem.sample_of(summary.undefined_group);
      missing(bad);
      samples = defined;
      samples.erase(std::find(samples.begin(), samples.end(), bad));
      continue;
    }
    for (size_t g = 0; g < problem.groups().size(); ++g) {
      const int sample = problem.sample_of(static_cast<int>(g));
      if (sample < 0) continue;
      Cost cost;
      if (problem.evaluate(static_cast<int>(g), state, 0, cost)) {
        chi2[unit_[sample]] += cost.chi2;
        count[unit_[sample]] += numbers(sample);
      } else {
        missing(sample);
      }
    }
    return;
  }
}

/// On every fold, fitted to the others (or, not `fitted`, at `from`).
Search::Score Search::score(const std::vector<char>& kept, const Values& from, bool fitted) const {
  const size_t units = fold_of_unit_.size();
  std::vector<double> chi2(units, 0.0), count(units, 0.0);
  for (int fold = 0; fold < folds_; ++fold) {
    std::optional<Values> values = from;
    if (fitted) values = fit(kept, from, fold);
    if (!values) return {std::vector<double>(units, kMissing), kNan};
    judge(*values, fold, chi2, count);
  }
  Score out;
  double sum = 0;
  for (size_t u = 0; u < units; ++u) {
    out.relative.push_back(chi2[u] / std::max(1.0, count[u]));
    sum += std::log1p(out.relative.back());
  }
  out.error = std::sqrt(std::expm1(sum / static_cast<double>(units)));
  return out;
}

bool Search::better(const Score& before, const Score& after) const {
  const size_t units = before.relative.size();
  std::vector<double> by_fold(folds_, 0.0);
  double mean = 0, squares = 0;
  for (size_t u = 0; u < units; ++u) {
    const double d = std::log1p(before.relative[u]) - std::log1p(after.relative[u]);
    by_fold[fold_of_unit_[u]] += d;
    mean += d / static_cast<double>(units);
  }
  for (size_t u = 0; u < units; ++u) {
    const double d = std::log1p(before.relative[u]) - std::log1p(after.relative[u]) - mean;
    squares += d * d;
  }
  const double error = std::sqrt(squares / static_cast<double>(std::max<size_t>(1, units - 1)) /
                                 static_cast<double>(units));
  const auto folds = std::count_if(by_fold.begin(), by_fold.end(), [](double d) { return d > 0; });
  return mean > kUnlikely * error && after.error < (1 - kWorthwhile) * before.error &&
         2 * folds > folds_;
}

std::optional<Staging> Search::run() {
  const auto proceed = [&](const std::string& trial) {
    return !options_.progress || options_.progress(trial);
  };
  if (!proceed("mounts")) return std::nullopt;
  make_folds();
  start();
  Staging out;
  out.folds = folds_;
  out.by_target = by_target_;
  out.units = static_cast<int>(fold_of_unit_.size());
  const auto record = [&](size_t g, bool removal, bool kept, double before, double after) {
    out.trials.push_back(
        {groups_[g].name, removal, kept, before, after, names_of(table_, groups_[g].free), 0});
    for (const Freed& f : groups_[g].free)
      out.trials.back().numbers += static_cast<int>(f.components.size());
  };

  // The mounts: for the record, what they do.
  std::vector<char> kept(groups_.size(), 0);
  std::vector<int> order;
  Values now = start_, at_rig = start_;
  at_rig.shared = initial_;
  Score score_now = score(kept, at_rig, false);
  if (!groups_[0].free.empty()) {
    kept[0] = 1;
    order.push_back(0);
    if (std::optional<Values> fitted = fit(kept, now, -1)) now = *fitted;
    const bool given = std::none_of(rig_.sensors.begin(), rig_.sensors.end(),
                                    [](const Sensor& s) { return !s.pose_given; });
    const double before = given ? score_now.error : kNan;
    score_now = score(kept, now, true);
    record(0, false, true, before, score_now.error);
  }

  const std::vector<Group> whole_groups = groups_;
  std::vector<int> kept_when_tried(groups_.size(),
                                   -1);  // how many were kept when this one was tried
  bool news = true;
  for (int pass = 0; pass < 3 && news; ++pass) {
    news = false;
    for (size_t g = 1; g < groups_.size(); ++g) {
      if (kept[g] || kept_when_tried[g] == static_cast<int>(order.size())) continue;
      kept_when_tried[g] = static_cast<int>(order.size());
      groups_[g] = whole_groups[g];
      drop_unobservable(groups_[g], kept, now.shared);
      if (groups_[g].free.empty()) {
        if (pass == 0) record(g, false, false, kNan, kNan);
        continue;
      }
      if (!proceed(groups_[g].name)) return std::nullopt;
      std::vector<char> trial = kept;
      trial[g] = 1;
      const std::optional<Values> fitted = fit(trial, now, -1);
      const Score with = fitted ? score(trial, *fitted, true)
                                : Score{std::vector<double>(fold_of_unit_.size(), kMissing), kNan};
      const bool keep = better(score_now, with);
      record(g, false, keep, score_now.error, with.error);
      if (!keep) continue;
      news = true;
      kept = trial;
      now = *fitted;
      score_now = with;
      order.push_back(static_cast<int>(g));
    }
  }

  for (size_t at = order.size() < 2 ? 0 : order.size() - 1;
       at-- > 1;) {  // the last one has just stood this very test
    const int g = order[at];
    std::vector<char> trial = kept;
    trial[g] = 0;
    const std::vector<Freed> free = freed(kept);
    if (std::none_of(groups_[g].free.begin(), groups_[g].free.end(),
                     [&](const Freed& f) { return has(free, f.parameter, f.components[0]); }))
      continue;  // offsets that geometry contains
    if (!proceed("without " + groups_[g].name)) return std::nullopt;
    Values from = now;
    from.shared = reset(now.shared, trial);
    const std::optional<Values> fitted = fit(trial, from, -1);
    if (!fitted) continue;
    const Score less = score(trial, *fitted, true);
    const bool stays = better(less, score_now);
    record(g, true, stays, less.error, score_now.error);
    if (stays) continue;
    kept = trial;
    now = *fitted;
    score_now = less;
    order.erase(order.begin() + static_cast<long>(at));
  }
  out.steps = explicit_steps(kept, order);
  if (out.steps.empty())
    throw std::invalid_argument(
        "automatic staging: the data determine nothing that could be freed");
  return out;
}

std::vector<Step> Search::explicit_steps(const std::vector<char>& all_kept,
                                         const std::vector<int>& order) const {
  std::vector<Step> out;
  const std::vector<int> sensors = indices(rig_.sensors.size());
  // Targets that only held-out samples see: named like those of their kind, estimated when they are
  // judged.
  std::vector<Freed> held_out;
  for (const Freed& h : of_held_out_) {
    const int t = static_cast<int>(
        std::find(table_.target_pose.begin(), table_.target_pose.end(), h.parameter) -
        table_.target_pose.begin());
    Freed like = h;
    for (const Freed& f : groups_.empty() ? std::vector<Freed>() : groups_[0].free) {
      const auto u = std::find(table_.target_pose.begin(), table_.target_pose.end(), f.parameter);
      if (u == table_.target_pose.end()) continue;
      const Target &a = rig_.targets[t], &b = rig_.targets[u - table_.target_pose.begin()];
      if (a.type == b.type && a.count() == b.count()) like = {h.parameter, f.components};
    }
    held_out.push_back(like);
  }
  if (absent_in_part_) {
    Step step;
    step.name = "start";
    step.sensors = sensors;
    std::vector<Freed> poses;
    for (const Freed& f : groups_[0].free) poses.push_back(whole(table_, f.parameter));
    step.free = names_of(table_, poses);
    out.push_back(step);
  }
  std::vector<char> kept(all_kept.size(), 0);
  for (int g : order) {
    kept[g] = 1;
    Step step;
    step.name = groups_[g].name;
    step.sensors = sensors;
    std::vector<Freed> free = freed(kept);
    merge(free, held_out);
    for (size_t h = 0; h < groups_.size(); ++h) {
      if (!kept[h]) continue;
      std::vector<Freed> own;
      for (const Freed& f : groups_[h].free)
        for (int c : f.components)
          if (has(free, f.parameter, c)) merge(own, {{f.parameter, {c}}});
      if (h == 0) merge(own, held_out);
      const std::vector<Freed> named = table_.select(groups_[h].name);  // of a geometry/BASE..TIP
      const bool same = !own.empty() && without(named, own).empty() && without(own, named).empty();
      const std::vector<std::string> names =
          same ? std::vector<std::string>{groups_[h].name} : names_of(table_, own);
      step.free.insert(step.free.end(), names.begin(), names.end());
      for (const std::string& name : names) {
        PriorSetting prior;
        prior.pattern = name;
        for (const Freed& f : table_.select(name))
          for (const Prior& p : groups_[h].priors)
            if (p.parameter == f.parameter && p.component == f.components[0])
              prior.translation = prior.rotation = p.sigma;
        if (prior.translation > 0) step.priors.push_back(prior);
      }
    }
    out.push_back(step);
  }
  return out;
}

}  // namespace

std::optional<Staging> stage(const Rig& rig, const std::vector<Sample>& samples,
                             const StagingOptions& options) {
  return Search(rig, samples, options).run();
}

}  // namespace kincal
