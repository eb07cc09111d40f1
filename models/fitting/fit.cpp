#include "fit.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <stdexcept>

#include "robust.h"

namespace kincal {
namespace {

// Middle residual, in standard deviations, from where on a start is far off for a robust loss.
constexpr double kRough = 10;

/// Samples with a residual that is undefined at the given values.
std::set<int> undefined_samples(Estimation& problem, const Values& values) {
  const VectorXd state = problem.pack(values);
  problem.renew(state);
  std::set<int> out;
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    Cost cost;
    const bool defined =
        problem.evaluate(static_cast<int>(g), state, 0, cost) && std::isfinite(cost.doubled);
    const int sample = problem.sample_of(static_cast<int>(g));
    if (!defined && sample >= 0) out.insert(sample);
  }
  return out;
}

/// Samples in which views of the setup's sensors show a free target whose pose is not known.
std::vector<int> with_unknown_targets(const Recording& recording, const std::vector<int>& samples,
                                      const std::vector<int>& sensors, const Values& values) {
  std::vector<int> out;
  for (int i : samples)
    for (const View& v : recording.samples[i].views) {
      const bool takes_part = std::count(sensors.begin(), sensors.end(), v.sensor) > 0;
      if (!takes_part || recording.rig.targets[v.target].link >= 0 ||
          values.targets.count({i, v.target}))
        continue;
      out.push_back(i);
      break;
    }
  return out;
}

/// The problem of the samples that can start, with the free targets' poses in place.
std::shared_ptr<Estimation> started_problem(const Recording& recording,
                                            const std::vector<int>& samples,
                                            const EstimationSetup& setup, const FitOptions& options,
                                            Fit& out) {
  const Loss loss = options.start_loss.value_or(setup.loss);
  TargetStarts how = options.targets;
  const auto start = [&](const std::vector<int>& some) {
    start_targets(recording, some, setup.sensors, loss, out.values, how);
  };
  if (!options.leave_out_undefined) {
    const auto problem =
        options.problem ? options.problem : std::make_shared<Estimation>(recording, samples, setup);
    start(with_unknown_targets(recording, samples, setup.sensors, out.values));
    return problem;
  }
  std::set<int> undefined;
  how.progress = {};  // of one sample
  for (int i : samples) try {
      start({i});
    } catch (const std::runtime_error&) {
      undefined.insert(i);
    }
  const auto left = [&] {
    std::vector<int> some;
    for (int i : samples)
      if (!undefined.count(i)) some.push_back(i);
    return some;
  };
  auto problem = std::make_shared<Estimation>(recording, left(), setup);
  const std::set<int> undefined_at_start = undefined_samples(*problem, out.values);
  undefined.insert(undefined_at_start.begin(), undefined_at_start.end());
  out.left_out.assign(undefined.begin(), undefined.end());
  if (!undefined_at_start.empty()) problem = std::make_shared<Estimation>(recording, left(), setup);
  return problem;
}

/// A robust loss takes residuals for outliers, and where the start is far off nearly all of them.
bool rough_for_loss(const Recording& recording, Fit& out) {
  Estimation& problem = *out.problem;
  const Loss& loss = problem.setup().loss;
  if (loss.kind == LossKind::none || loss.from_data) return false;
  problem.renew(out.state);
  const std::vector<double> ratios =
      robust_noise_ratios(recording.rig, problem.residuals(out.state));
  return *std::max_element(ratios.begin(), ratios.end()) > kRough;
}

/// Solves again from where a graduated fit leads, and keeps what costs less.
void solve_from_graduated(const Recording& recording, const FitOptions& options,
                          const VectorXd& start, Fit& out) {
  VectorXd state = start;
  SolveSummary summary = solve_graduated(*out.problem, recording.rig, options.solver, state);
  out.problem->set_noise_ratios(std::vector<double>(recording.rig.sensors.size(), 1.0));
  const auto undefined = [&] { return summary.outcome == Outcome::undefined_start; };
  if (!undefined()) summary = uncancelled(out.solver->solve(state));
  if (undefined() || summary.cost.doubled >= out.summary.cost.doubled) return;
  out.summary = std::move(summary);
  out.state = std::move(state);
}

/// From the values as they are.
void minimise(const Recording& recording, const FitOptions& options, Fit& out) {
  Estimation& problem = *out.problem;
  out.state = problem.pack(out.values);
  if (problem.setup().loss.from_data) {
    out.summary =
        solve_graduated(problem, recording.rig, options.solver, out.state, options.noise_ratios);
    if (!options.converge || !out.defined()) return;
  }
  out.solver = std::make_unique<LevenbergMarquardt>(problem, options.solver);
  const bool rough = rough_for_loss(recording, out);
  const VectorXd start = rough ? out.state : VectorXd();
  out.summary = uncancelled(out.solver->solve(out.state));
  if (rough && out.defined()) solve_from_graduated(recording, options, start, out);
}

/// Finds samples with free targets that fit badly where the fit ended, and for which another start
/// of their targets, everything shared held, is better; puts these into the values. Returns whether
/// there are any.
bool find_better_targets(const Recording& recording, Fit& out) {
  constexpr double kBetter = 0.9;  // of the cost
  Estimation& problem = *out.problem;
  problem.prepare(out.state);
  struct Bad {
    int sample;
    double doubled;
  };
  std::vector<Bad> bad;
  for (size_t g = 0; g < problem.groups().size(); ++g) {
    const GroupShape& shape = problem.groups()[g];
    const int sample = problem.sample_of(static_cast<int>(g));
    Cost cost;
    if (sample < 0 || shape.private_size < 6 ||
        !problem.evaluate(static_cast<int>(g), out.state, 0, cost))
      continue;
    const double dof = std::max(1, shape.rows - shape.private_size);
    if (cost.doubled > dof + 5 * std::sqrt(2 * dof) + 10) bad.push_back({sample, cost.doubled});
  }
  if (bad.empty()) return false;
  problem.unpack(out.state, out.values);
  EstimationSetup alone = problem.setup();
  alone.free.clear();
  alone.priors.clear();
  alone.apart = true;
  alone.loss.from_data = false;
  alone.initial = problem.initial();
  bool better = false;
  for (const Bad& one : bad) {
    const std::vector<View>& views = recording.samples[one.sample].views;
    if (std::none_of(views.begin(), views.end(),
                     [&](const View& v) { return recording.rig.targets[v.target].link < 0; }))
      continue;
    Values start;
    start.shared = out.values.shared;
    FitOptions options;
    options.solver.relative_decrease = 1e-6;
    try {
      const Fit again = fit(recording, {one.sample}, alone, std::move(start), options);
      if (!again.defined() || !(again.summary.cost.doubled < kBetter * one.doubled)) continue;
      for (const auto& [key, pose] : again.values.targets) out.values.targets[key] = pose;
      for (const auto& [key, error] : again.values.errors) out.values.errors[key] = error;
      better = true;
    } catch (const std::runtime_error&) {  // no pose can be evaluated: it stays
    }
  }
  return better;
}

/// FitOptions::restart_targets. As what is shared gets better, more targets do.
void restart_targets(const Recording& recording, const FitOptions& options, Fit& out) {
  constexpr int kMost = 5;
  for (int i = 0; i < kMost; ++i) {
    if (!out.defined() || !find_better_targets(recording, out)) return;
    SolveSummary before = std::move(out.summary);
    VectorXd state = std::move(out.state);
    out.solver.reset();
    minimise(recording, options, out);
    if (!out.defined() || !(out.summary.cost.doubled < before.cost.doubled)) {
      out.summary = std::move(before);
      out.state = std::move(state);
      return;
    }
    out.summary.iterations += before.iterations;
    out.summary.history.insert(out.summary.history.begin(), before.history.begin(),
                               before.history.end());
  }
}

}  // namespace

Fit fit(const Recording& recording, const std::vector<int>& samples, const EstimationSetup& setup,
        Values start, const FitOptions& options) {
  Fit out;
  out.values = std::move(start);
  out.problem = started_problem(recording, samples, setup, options, out);
  if (out.problem->empty()) {
    out.state = out.problem->pack(out.values);
    out.summary.outcome = out.left_out.empty() ? Outcome::converged : Outcome::undefined_start;
    return out;
  }
  minimise(recording, options, out);
  if (!out.defined() && !options.leave_out_undefined) {
    if (options.trust_start) out.values.targets.clear();
    start_targets(recording, samples, setup.sensors, options.start_loss.value_or(setup.loss),
                  out.values);
    minimise(recording, options, out);
  }
  if (options.restart_targets) restart_targets(recording, options, out);
  if (out.solver) out.linear_solver = out.solver->linear_solver();
  if (!options.keep_solver) out.solver.reset();
  if (out.defined()) out.problem->unpack(out.state, out.values);
  return out;
}

}  // namespace kincal
