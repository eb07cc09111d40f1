#include "free_targets.h"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <stdexcept>

#include "../../solver/levenberg_marquardt.h"
#include "../estimation/estimation.h"
#include "../rig/numbers.h"
#include "../rig/targets.h"
#include "closed_form.h"

namespace kincal {

namespace {

/// Twice the cost of a problem of one sample; nullopt where a residual is undefined.
std::optional<double> cost_at(Estimation& problem, const Values& values) {
  const VectorXd state = problem.pack(values);
  problem.renew(state);
  Cost cost;
  if (!problem.evaluate(0, state, 0, cost) || !std::isfinite(cost.doubled)) return std::nullopt;
  return cost.doubled;
}

/// Free targets that a sample's views of the marked sensors show, in the order of the views.
std::vector<int> free_targets(const Rig& rig, const Sample& sample, const std::vector<char>& used) {
  std::vector<int> targets;
  for (const View& v : sample.views)
    if (used[v.sensor] && rig.targets[v.target].link < 0 &&
        std::find(targets.begin(), targets.end(), v.target) == targets.end())
      targets.push_back(v.target);
  return targets;
}

/// Whether none of a sample's views of a target, by the marked sensors, gives a pose to start from;
/// `types`: of these sensors.
bool no_view_tells_a_pose(const Rig& rig, const Sample& sample, int target,
                          const std::vector<char>& used, std::string& types) {
  for (const View& v : sample.views) {
    const Sensor& sensor = rig.sensors[v.sensor];
    if (!used[v.sensor] || v.target != target) continue;
    if (sensor.model->measurement_kind() != MeasurementKind::none) return false;
    if (types.find(sensor.type) == std::string::npos)
      types += (types.empty() ? "" : ", ") + sensor.type;
  }
  return true;
}

/// The better of the two best proposals, with residuals minimised. `order`: cost and index of each
/// proposal, ascending; `trial`: what else the problem depends on; `relative_decrease`: where it
/// stops (SolverOptions).
Pose refined_proposal(Estimation& problem, const std::pair<int, int>& key,
                      const std::vector<Pose>& found,
                      const std::vector<std::pair<double, size_t>>& order, Values& trial,
                      double relative_decrease) {
  double least = kInfinity;
  Pose best = found[order[0].second];
  for (size_t i = 0; i < order.size() && i < 2; ++i) {
    trial.targets[key] = found[order[i].second];
    VectorXd state = problem.pack(trial);
    SolverOptions options;
    options.max_iterations = 60;
    options.relative_decrease = relative_decrease;
    const SolveSummary summary = LevenbergMarquardt(problem, options).solve(state);
    if (summary.outcome != Outcome::undefined_start && summary.cost.doubled < least * (1 - 1e-9)) {
      least = summary.cost.doubled;
      problem.unpack(state, trial);
      best = trial.targets[key];
    }
  }
  return best;
}

/// One target of each of a few samples, which are taken in their order.
struct OneTarget {
  std::unique_ptr<Estimation> problem;
  int taken = 0;
};

/// start_targets() of a few samples.
void start_some(const Recording& recording, const std::vector<int>& samples,
                const std::vector<int>& sensors, const Loss& loss, Values& values,
                const TargetStarts& how) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  std::vector<char> used(rig.sensors.size(), 0);
  for (int s : sensors) used[s] = 1;
  std::map<int, OneTarget> laid_out;  // by target
  for (int index : samples) {
    const Sample& sample = recording.samples[index];
    for (int target : free_targets(rig, sample, used)) {
      const std::pair<int, int> key{index, target};
      OneTarget& of = laid_out[target];
      if (!of.problem) {
        EstimationSetup setup;
        setup.noise = NoiseMode::none;
        setup.sensors = sensors;
        setup.only_target = target;
        setup.apart = true;
        of.problem = std::make_unique<Estimation>(recording, samples, setup);
      }
      Estimation& problem = *of.problem;
      while (problem.sample_of(0) != index) problem.take_alone(++of.taken);
      problem.set_loss({LossKind::soft_l1, 1});  // that ranks proposals
      Values trial;
      trial.shared = values.shared;
      const auto before = values.targets.find(key);
      if (before != values.targets.end()) {  // from an earlier step: kept, if it can be evaluated
        trial.targets[key] = before->second;
        if (cost_at(problem, trial)) continue;
      }
      std::vector<Pose> found;
      for (const View& v : sample.views)
        if (used[v.sensor] && v.target == target)
          for (const Pose& p : proposals(rig, table, values.shared, sample, v, how.memory))
            found.push_back(p);
      for (const Pose& p : proposals_of_all(rig, table, values.shared, sample, target, used))
        found.push_back(p);
      std::string types;
      if (found.empty() && no_view_tells_a_pose(rig, sample, target, used, types))
        throw std::runtime_error("sample '" + sample.id +
                                 "': no initial value found for the pose of target '" +
                                 rig.targets[target].name + "': the sensors that see it (" + types +
                                 ") do not determine its pose; let another sensor see it too, or "
                                 "mount it on a link with a pose");
      std::vector<std::pair<double, size_t>> order;
      for (size_t i = 0; i < found.size(); ++i) {
        trial.targets[key] = found[i];
        if (const std::optional<double> cost = cost_at(problem, trial)) order.push_back({*cost, i});
      }
      if (order.empty())
        throw std::runtime_error(
            "sample '" + sample.id + "': no initial value found for the pose of target '" +
            rig.targets[target].name +
            "': at every pose that its views propose some point lies behind a camera");
      std::sort(order.begin(), order.end());
      if (how.effort == StartEffort::proposed) {
        values.targets[key] = found[order[0].second];
        continue;
      }
      problem.set_loss(loss);
      values.targets[key] = refined_proposal(problem, key, found, order, trial,
                                             how.effort == StartEffort::converged ? 0 : 1e-6);
    }
  }
}

}  // namespace

void start_targets(const Recording& recording, const std::vector<int>& samples,
                   const std::vector<int>& sensors, const Loss& loss, Values& values,
                   const TargetStarts& how) {
  for (size_t first = 0; first < samples.size(); first += kLaidOutTogether) {
    const size_t count = std::min(kLaidOutTogether, samples.size() - first);
    how.progress.share(static_cast<double>(first), static_cast<double>(samples.size()));
    start_some(recording, {samples.begin() + first, samples.begin() + first + count}, sensors, loss,
               values, how);
  }
  how.progress.share(1);
}

bool some_sensor_tells_no_pose(const Rig& rig) {
  return std::any_of(rig.sensors.begin(), rig.sensors.end(), [](const Sensor& s) {
    return s.model->measurement_kind() == MeasurementKind::none;
  });
}

namespace {

/// The better of a view's poses, with its residuals minimised.
std::optional<Pose> minimised_pose(const Rig& rig, const ParameterTable& table,
                                   const VectorXd& values, const View& view) {
  // Alone with its sensor at the origin of a one-view problem: the same refinement as for free
  // targets.
  Rig alone;
  alone.tree.links = {"base"};
  finish_tree(alone.tree);
  alone.targets = {rig.targets[view.target]};
  alone.targets[0].link = -1;
  alone.sensors = {rig.sensors[view.sensor]};
  alone.sensors[0].link = 0;
  alone.sensors[0].link_T_sensor = Pose();
  alone.sensors[0].mount_joint = alone.sensors[0].pose_of = alone.targets[0].mount_joint = -1;
  std::vector<Sample> one(1);
  one[0].views = {view};
  one[0].views[0].sensor = one[0].views[0].target = 0;
  const Recording recording(std::move(alone), std::move(one));
  const ParameterTable& small = recording.table;
  Values result;
  result.shared = small.initial;
  const auto copy = [&](int to, int from) {
    if (from < 0) return;
    const Parameter& p = table.all[from];
    result.shared.segment(small.all[to].start, p.size()) = values.segment(p.start, p.size());
  };
  for (size_t b = 0; b < recording.rig.sensors[0].parameters.size(); ++b)
    copy(small.sensor_block[0] + static_cast<int>(b),
         table.sensor_block[view.sensor] + static_cast<int>(b));
  copy(small.target_square[0], table.target_square[view.target]);
  copy(small.target_warp[0], table.target_warp[view.target]);
  copy(small.target_print[0], table.target_print[view.target]);
  copy(small.target_points[0], table.target_points[view.target]);
  try {
    start_targets(recording, {0}, {0}, {LossKind::soft_l1, 3}, result, {StartEffort::converged});
  } catch (const std::runtime_error&) {  // at every pose some point lies behind the camera
    return std::nullopt;
  }
  return result.targets[{0, 0}];
}

}  // namespace

std::optional<Pose> pose_from_view(const Rig& rig, const ParameterTable& table,
                                   const VectorXd& values, const View& view,
                                   ViewPosesMemory* memory) {
  const MeasurementKind kind = rig.sensors[view.sensor].model->measurement_kind();
  const Matrix3Xd points = select_columns(target_points(rig, table, values, view.target),
                                          view_ids(view, rig.targets[view.target]));
  if (kind == MeasurementKind::chain) return Pose();
  if (kind != MeasurementKind::pose && !((kind == MeasurementKind::points ||
                                          (kind == MeasurementKind::rays && points.cols() >= 4)) &&
                                         !on_a_line(points)))
    return std::nullopt;
  if (!memory) return minimised_pose(rig, table, values, view);
  std::optional<std::optional<Pose>>& known = memory->of(rig, table, values, view).minimised;
  if (!known) known = minimised_pose(rig, table, values, view);
  return *known;
}

}  // namespace kincal
