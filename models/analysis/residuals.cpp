#include "residuals.h"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <map>
#include <numeric>
#include <stdexcept>

#include "../estimation/estimation.h"
#include "../fitting/fit.h"
#include "../fitting/free_targets.h"
#include "../fitting/unknown_poses.h"
#include "../rig/numbers.h"
#include "linearisation.h"

namespace kincal {
namespace {

/// Sums over the residuals of one sensor.
struct Sums {
  double squared = 0, rotation = 0, whitened = 0;
  long points = 0, count = 0;
};

void add_sums(const Rig& rig, const std::vector<ViewResiduals>& residuals,
              std::vector<Sums>& sums) {
  for (const ViewResiduals& r : residuals) {
    Sums& s = sums[r.view->sensor];
    const SensorModel& model = *rig.sensors[r.view->sensor].model;
    if (model.measures_pose()) {
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

// Of the cost of a sample by itself: a step that lowers it by no more changes no figure that is
// shown. (Several samples together are minimised to the end, as a calibration is.)
constexpr double kCostStands = 1e-10;

constexpr double kMiddleOfTails = 0.3;  // the median over the root mean square

/// How samples are judged: everything shared is held but `free`.
struct Judge {
  NoiseMode noise = NoiseMode::none;
  Loss loss;
  std::vector<Freed> free;
  const Values* start = nullptr;  // poses to start free targets from, else by proposals
  bool with_dof = false;
  std::vector<double> noise_ratios;
  enum class Keep { all, raw, sums };
  Keep keep = Keep::all;  // of the residuals
  Progress progress;
};

/// Parts hands out the shares of work that is done in parts, one after the other.
struct Parts {
  const Progress& progress;
  size_t all, done = 0;

  Progress next(size_t count) {
    const double from = static_cast<double>(done) / static_cast<double>(all);
    done += count;
    return progress.between(from, static_cast<double>(done) / static_cast<double>(all));
  }
};

struct Judged {
  std::vector<std::string> not_converged;  // samples
  double chi2 = 0;
  long dof = 0;
  std::vector<Sums> sums;  // by sensor
  std::vector<ViewResiduals> residuals;
  std::vector<std::string> undefined;  // samples without any evaluable start
};

struct Together {
  std::vector<int> tied, lone;
};

/// Samples that depend on something in `free` are judged together, the others each alone.
Together judged_together(const Recording& recording, const std::vector<int>& samples,
                         const EstimationSetup& setup, const std::vector<Freed>& free) {
  if (free.empty()) return {{}, samples};
  Together out;
  for (int i : samples) {
    const std::vector<char> used = Estimation(recording, {i}, setup).influencing();
    const bool tied = std::any_of(free.begin(), free.end(),
                                  [&](const Freed& f) { return used[f.parameter] != 0; });
    (tied ? out.tied : out.lone).push_back(i);
  }
  return out;
}

/// The poses of free targets of some samples that are known.
Values known_values(const Recording& recording, const std::vector<int>& samples,
                    const VectorXd& shared, const Values* start) {
  Values out;
  out.shared = shared;
  if (!start) return out;
  for (int i : samples)
    for (const View& v : recording.samples[i].views) {
      const auto known = start->targets.find({i, v.target});
      if (recording.rig.targets[v.target].link < 0 && known != start->targets.end())
        out.targets[{i, v.target}] = known->second;
    }
  return out;
}

/// Poses of mounted targets and sensors that are estimated with the samples and that the rig does
/// not give start where these put them.
void start_open_poses(const Recording& recording, const std::vector<int>& samples,
                      const std::vector<Freed>& free, Values& values) {
  std::vector<int> unknown;
  for (const Freed& f : free) {
    const Parameter& p = recording.table.all[f.parameter];
    if (!is_given(recording.rig, p) && f.whole(p)) unknown.push_back(f.parameter);
  }
  if (!unknown.empty()) start_unknown_poses(recording, samples, unknown, values);
}

/// Samples that are judged together, and what their problem is; that may exist already.
struct JudgedGroup {
  std::vector<int> samples;
  const EstimationSetup& setup;
  std::shared_ptr<Estimation> problem;
};

/// Minimises one group of samples and adds what came out.
void judge_group(const Recording& recording, const JudgedGroup& group, const VectorXd& shared,
                 const Judge& how, Judged& out) {
  FitOptions options;
  options.trust_start = true;
  options.problem = group.problem;
  if (group.samples.size() == 1) options.solver.relative_decrease = kCostStands;
  Values start = known_values(recording, group.samples, shared, how.start);
  start_open_poses(recording, group.samples, group.setup.free, start);
  Values again;
  if (group.samples.size() > 1) again = start;
  Fit one;
  try {
    one = fit(recording, group.samples, group.setup, std::move(start), options);
  } catch (const std::runtime_error&) {  // no pose of a target can be evaluated
    one.summary.outcome = Outcome::undefined_start;
  }
  if (!one.defined() && group.samples.size() > 1) {  // those that cannot be evaluated are left out
    options.leave_out_undefined = true;
    one = fit(recording, group.samples, group.setup, std::move(again), options);
    for (int i : one.left_out) out.undefined.push_back(recording.samples[i].id);
    if (!one.defined() && one.left_out.empty())
      for (int i : group.samples) out.undefined.push_back(recording.samples[i].id);
  } else if (!one.defined()) {
    out.undefined.push_back(recording.samples[group.samples[0]].id);
  }
  if (!one.defined()) return;
  if (one.problem->groups().empty()) return;
  Estimation& problem = *one.problem;
  const VectorXd& state = one.state;
  const SolveSummary& summary = one.summary;
  if (summary.outcome != Outcome::converged)
    for (int i : group.samples) out.not_converged.push_back(recording.samples[i].id);
  out.chi2 += summary.cost.chi2;
  if (how.with_dof) {
    problem.renew(state);
    out.dof += observe(problem, state).dof();
  }
  std::vector<ViewResiduals> residuals = problem.residuals(state);
  add_sums(recording.rig, residuals, out.sums);
  if (how.keep == Judge::Keep::sums) return;
  for (ViewResiduals& r : residuals) {
    if (how.keep == Judge::Keep::raw) r.whitened.resize(0);
    out.residuals.push_back(std::move(r));
  }
}

Judged judge(const Recording& recording, const std::vector<int>& samples, const VectorXd& shared,
             const VectorXd& initial, const Judge& how) {
  Judged out;
  out.sums.resize(recording.rig.sensors.size());
  EstimationSetup setup;
  setup.initial = initial;
  setup.noise = how.noise;
  setup.loss = how.loss;
  setup.loss.from_data = false;  // at the noise ratios as they are
  setup.noise_ratios = how.noise_ratios;
  setup.sensors = indices(recording.rig.sensors.size());
  const Together groups = judged_together(recording, samples, setup, how.free);
  size_t done = 0;
  const auto tell = [&](size_t count) {
    how.progress.share(static_cast<double>(done), static_cast<double>(samples.size()));
    done += count;
  };
  if (!groups.tied.empty()) {
    EstimationSetup tied = setup;
    tied.free = how.free;
    tell(groups.tied.size());
    judge_group(recording, {groups.tied, tied, nullptr}, shared, how, out);
  }
  setup.apart = true;
  for (size_t first = 0; first < groups.lone.size(); first += kLaidOutTogether) {
    const std::vector<int> some(
        groups.lone.begin() + first,
        groups.lone.begin() + std::min(first + kLaidOutTogether, groups.lone.size()));
    const auto problem = std::make_shared<Estimation>(recording, some, setup);
    for (int i = 0; i < problem->sample_count(); ++i) {
      tell(1);
      problem->take_alone(i);
      // A robust fit changes the loss of its problem: that is not used again.
      const auto again = how.loss.kind == LossKind::none ? problem : nullptr;
      judge_group(recording, {{problem->sample_of(0)}, setup, again}, shared, how, out);
    }
  }
  return out;
}

void note_unfinished(const Judged& judged, bool train, const char* column,
                     std::vector<Unfinished>& out) {
  if (!judged.not_converged.empty()) out.push_back({train, column, judged.not_converged});
}

double rms(double squared, long points) { return points ? std::sqrt(squared / points) : kNan; }

/// Root mean squares of one sensor in one split.
void set_statistics(const Sums& now, const Sums& read, const Sums& before, bool measures_pose,
                    SplitStatistics& s) {
  s.points = now.points;
  s.rms = rms(now.squared, now.points);
  s.rms_as_read = rms(read.squared, read.points);
  s.rms_before = rms(before.squared, before.points);
  if (measures_pose) {
    s.rotation = rms(now.rotation, now.points);
    s.rotation_as_read = rms(read.rotation, read.points);
    s.rotation_before = rms(before.rotation, before.points);
  }
  s.whitened_squared = now.whitened;
  s.whitened_count = now.count;
}

/// Appends, in the order of samples and views.
void append(std::vector<ViewResiduals>& from, std::vector<ViewResiduals>& to) {
  std::stable_sort(from.begin(), from.end(), [](const ViewResiduals& a, const ViewResiduals& b) {
    return a.sample != b.sample ? a.sample < b.sample : a.view < b.view;
  });
  if (to.empty())
    to = std::move(from);
  else
    std::move(from.begin(), from.end(), std::back_inserter(to));
}

}  // namespace

bool neighbours_err_alike(const std::vector<Sample>& samples,
                          const std::vector<ViewResiduals>& views) {
  constexpr double kAlike = 0.3;  // correlation
  double products = 0, squares = 0;
  for (const ViewResiduals& v : views) {
    const Eigen::Index points = static_cast<Eigen::Index>(v.view->ids.size());
    if (!samples[v.sample].train || points < 4 || v.raw.size() < points || !v.raw.allFinite())
      continue;
    const Eigen::Index rows = v.raw.size() / points, rest = v.raw.size() - rows;
    products += v.raw.head(rest).dot(v.raw.tail(rest));
    squares += v.raw.head(rest).squaredNorm();
  }
  return products > kAlike * squares;
}

bool few_are_far(const std::vector<Sample>& samples, const std::vector<ViewResiduals>& views) {
  std::map<int, std::pair<std::vector<double>, Mean>> by_sensor;  // sizes, squares
  for (const ViewResiduals& v : views) {
    if (!samples[v.sample].train || !v.whitened.allFinite()) continue;
    auto& [sizes, squares] = by_sensor[v.view->sensor];
    for (const double r : v.whitened) sizes.push_back(std::abs(r));
    squares.sum += v.whitened.squaredNorm();
    squares.count += v.whitened.size();
  }
  return std::any_of(by_sensor.begin(), by_sensor.end(), [](const auto& s) {
    return median(s.second.first) < kMiddleOfTails * std::sqrt(s.second.second.value());
  });
}

SensorResult unseen(const Sensor& sensor) {
  SensorResult r;
  r.name = sensor.name;
  r.unit = sensor.model->unit();
  r.measures_pose = sensor.model->measures_pose();
  for (SplitStatistics* s : {&r.train, &r.test})
    s->rms_before = s->rms = s->rms_as_read = s->rotation_before = s->rotation =
        s->rotation_as_read = kNan;
  return r;
}

Residuals residuals(const Linearisation& at) {
  return residuals(at, at.problem().residuals(at.state()));
}

Residuals residuals(const Linearisation& at, std::vector<ViewResiduals> views,
                    const Progress& progress) {
  const Solution& solution = at.solution;
  const Recording& recording = *solution.recording;
  const Rig& rig = recording.rig;
  const std::vector<int>& last_sensors = solution.setup.sensors;
  Residuals out;
  std::vector<char> sees(rig.sensors.size(), 0);
  bool complete = true;  // the last step used every sensor that sees something in training
  for (const Sample& s : recording.samples)
    for (const View& v : s.views) {
      sees[v.sensor] = 1;
      if (s.train && !std::count(last_sensors.begin(), last_sensors.end(), v.sensor))
        complete = false;
    }
  std::vector<int> place(rig.sensors.size(), -1);
  for (size_t i = 0; i < rig.sensors.size(); ++i)
    if (sees[i]) {
      place[i] = static_cast<int>(out.sensors.size());
      out.sensors.push_back(unseen(rig.sensors[i]));
    }
  Parts parts = {progress, 3 * recording.samples.size()};  // each is judged in up to three ways
  for (bool train : {true, false}) {
    const std::vector<int> samples = recording.split(train);
    if (samples.empty()) continue;
    Judge how;
    how.progress = parts.next(samples.size());
    how.noise = solution.noise;
    how.loss = solution.setup.loss;
    how.noise_ratios = at.problem().setup().noise_ratios;
    how.start = &solution.values;
    if (!train) how.free = solution.seen_held_out;
    Judged now;
    if (train && complete) {
      now.sums.resize(rig.sensors.size());
      now.residuals.swap(views);
      add_sums(rig, now.residuals, now.sums);
    } else {
      now = judge(recording, samples, solution.values.shared, solution.initial, how);
    }
    how.progress = parts.next(samples.size());
    how.noise = NoiseMode::none;
    how.keep = train ? Judge::Keep::sums : Judge::Keep::raw;
    Judged read = judge(recording, samples, solution.values.shared, solution.initial, how);
    how.progress = parts.next(samples.size());
    how.keep = Judge::Keep::raw;
    Judged before = judge(recording, samples, solution.initial, solution.initial, how);
    for (size_t i = 0; i < rig.sensors.size(); ++i) {
      if (place[i] < 0) continue;
      SensorResult& sensor = out.sensors[place[i]];
      set_statistics(now.sums[i], read.sums[i], before.sums[i], sensor.measures_pose,
                     train ? sensor.train : sensor.test);
    }
    note_unfinished(now, train, "rms", out.unfinished);
    note_unfinished(read, train, "rms_as_read", out.unfinished);
    note_unfinished(before, train, "rms_before", out.unfinished);
    for (const std::string& id : before.undefined) out.undefined.push_back({id, true});
    for (const std::string& id : now.undefined) out.undefined.push_back({id, false});
    append(now.residuals, out.after);
    append(before.residuals, out.before);
    append(read.residuals, out.as_read);
  }
  return out;
}

void add_uncorrected(const Solution& rigid, Residuals& residuals) {
  const Residuals others = kincal::residuals(linearise(rigid));
  for (const SensorResult& other : others.sensors)
    for (SensorResult& sensor : residuals.sensors) {
      if (sensor.name != other.name) continue;
      sensor.train.rms_uncorrected = other.train.rms_as_read;
      sensor.train.rotation_uncorrected = other.train.rotation_as_read;
      sensor.test.rms_uncorrected = other.test.rms_as_read;
      sensor.test.rotation_uncorrected = other.test.rotation_as_read;
    }
}

Residuals held_out_as_read(const Solution& solution, const VectorXd& shared) {
  const Recording& recording = *solution.recording;
  Judge how;
  how.loss = solution.setup.loss;
  how.noise_ratios = solution.setup.noise_ratios;
  how.start = &solution.values;
  how.free = solution.seen_held_out;
  how.keep = Judge::Keep::raw;
  Judged read = judge(recording, recording.split(false), shared, solution.initial, how);
  Residuals out;
  append(read.residuals, out.as_read);
  return out;
}

/// The sample with the largest part of the sum of squares.
static void find_worst(const Recording& recording, Evaluation& out) {
  std::vector<double> squares(recording.samples.size(), 0);
  for (const ViewResiduals& v : out.views) squares[v.sample] += v.whitened.squaredNorm();
  const auto worst = std::max_element(squares.begin(), squares.end());
  const double all = std::accumulate(squares.begin(), squares.end(), 0.0);
  if (!(all > 0)) return;
  out.worst_sample = recording.samples[worst - squares.begin()].id;
  out.worst_share = *worst / all;
}

Evaluation evaluate(const Recording& recording, NoiseMode noise,
                    const std::vector<std::string>& patterns, const Progress& progress) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  std::vector<Freed> free;
  std::vector<char> plain(table.all.size(), 0);
  for (size_t i = 0; i < patterns.size(); ++i) {
    const std::vector<Freed> found = table.find(patterns[i], "free[" + std::to_string(i) + "]");
    if (table.is_plain_name(patterns[i])) plain[found[0].parameter] = 1;
    merge(free, found);
  }
  Evaluation out;
  const std::vector<int> open = open_poses(rig, table);
  for (int p : open) merge(free, {whole(table, p)});
  std::vector<char> influences(table.all.size(), 0);  // some view depends on it
  std::vector<int> place(rig.sensors.size(), -1);
  Parts parts = {progress, 2 * recording.samples.size()};  // each is judged in two ways
  for (bool train : {true, false}) {
    const std::vector<int> samples = recording.split(train);
    if (samples.empty()) continue;
    EstimationSetup setup;
    setup.sensors = indices(rig.sensors.size());
    const std::vector<char> used = Estimation(recording, samples, setup).influencing();
    Judge how;
    for (const Freed& f : free)
      if (used[f.parameter] || plain[f.parameter]) how.free.push_back(f);
    for (size_t p = 0; p < used.size(); ++p) influences[p] |= used[p];
    how.noise = noise;
    how.with_dof = true;
    how.progress = parts.next(samples.size());
    Judged now = judge(recording, samples, table.initial, table.initial, how);
    how.progress = parts.next(samples.size());
    how.noise = NoiseMode::none;
    how.with_dof = false;
    const Judged read = judge(recording, samples, table.initial, table.initial, how);
    out.undefined.insert(out.undefined.end(), now.undefined.begin(), now.undefined.end());
    note_unfinished(now, train, "rms", out.unfinished);
    note_unfinished(read, train, "rms_as_read", out.unfinished);
    out.chi2 += now.chi2;
    out.dof += now.dof;
    for (size_t i = 0; i < rig.sensors.size(); ++i) {
      if (now.sums[i].points == 0) continue;
      if (place[i] < 0) {
        place[i] = static_cast<int>(out.sensors.size());
        out.sensors.push_back(unseen(rig.sensors[i]));
      }
      SensorResult& sensor = out.sensors[place[i]];
      SplitStatistics& s = train ? sensor.train : sensor.test;
      set_statistics(now.sums[i], read.sums[i], Sums(), sensor.measures_pose, s);
    }
    append(now.residuals, out.views);
  }
  if (out.undefined.size() == recording.samples.size())
    throw std::runtime_error("no sample can be evaluated: in '" + out.undefined[0] +
                             "' a point lies behind a camera wherever its target is put" +
                             (some_sensor_tells_no_pose(rig)
                                  ? ", or its measurements do not determine the pose of its target"
                                  : ""));
  find_worst(recording, out);
  out.converged = out.unfinished.empty();
  for (int p : open)
    if (influences[p]) out.open.push_back(table.all[p].name);
  for (const std::string& pattern : patterns) {
    const std::vector<Freed> found = table.select(pattern);
    if (std::none_of(found.begin(), found.end(),
                     [&](const Freed& f) { return influences[f.parameter]; }))
      out.without_effect.push_back(pattern);
  }
  return out;
}

}  // namespace kincal
