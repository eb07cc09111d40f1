#include "start_poses.h"

#include <algorithm>
#include <optional>
#include <utility>

#include "../fitting/unknown_poses.h"
#include "../rig/scales.h"
#include "../rig/selection.h"

namespace kincal {
namespace {

constexpr double kPoor = 4;         // of cost per degree of freedom; of two costs
constexpr double kElsewhere = 0.2;  // m, rad: another minimum may be there

/// How the steps free a parameter.
struct HowFreed {
  bool at_all = false, whole = false, prior = false;
};

HowFreed how_freed(const std::vector<StepPlan>& plans, const ParameterTable& table, int parameter) {
  HowFreed out;
  for (const StepPlan& plan : plans) {
    const Freed* f = find_freed(plan.free, parameter);
    out.at_all = out.at_all || f;
    out.whole = out.whole || (f && f->whole(table.all[parameter]));
    for (const Prior& q : plan.priors) out.prior = out.prior || q.parameter == parameter;
  }
  return out;
}

/// Whether a parameter is the pose of a sensor or of a mounted target.
bool is_pose_of_body(const Parameter& p) {
  return p.kind == ParameterKind::sensor_pose || p.kind == ParameterKind::target_pose;
}

/// Poses that the rig leaves open and the steps free wholly, without a prior.
std::vector<int> absent_poses_to_find(const std::vector<StepPlan>& plans,
                                      const Recording& recording) {
  const ParameterTable& table = recording.table;
  std::vector<int> out;
  for (size_t i = 0; i < table.all.size(); ++i) {
    const int p = static_cast<int>(i);
    if (!is_pose_of_body(table.all[i]) || is_given(recording.rig, table.all[i])) continue;
    const HowFreed freed = how_freed(plans, table, p);
    if (freed.whole && !freed.prior) out.push_back(p);
  }
  return out;
}

/// A given pose that the steps free wholly, without a prior. A fixed joint's origin is found by the
/// pose of a sensor or target behind it, `body`, that is not to be found itself.
struct GivenPose {
  int parameter, body;
  std::optional<OriginProxy> proxy;  // of an origin
};

std::vector<GivenPose> given_poses(const std::vector<StepPlan>& plans, const Recording& recording) {
  const ParameterTable& table = recording.table;
  std::vector<GivenPose> out;
  std::vector<char> taken(table.all.size(), 0);
  for (const bool origins : {false, true})
    for (size_t i = 0; i < table.all.size(); ++i) {
      const int p = static_cast<int>(i);
      const Parameter& parameter = table.all[i];
      const bool origin = parameter.kind == ParameterKind::joint_origin;
      if (origin != origins || (!origin && !is_pose_of_body(parameter))) continue;
      const HowFreed freed = how_freed(plans, table, p);
      if (!origin && freed.at_all) taken[i] = 1;
      if (!freed.whole || freed.prior) continue;
      if (!origin && is_given(recording.rig, parameter)) out.push_back({p, p, std::nullopt});
      if (!origin) continue;
      if (const std::optional<OriginProxy> proxy = find_origin_proxy(recording, p, taken)) {
        out.push_back({p, proxy->body, proxy});
        taken[proxy->body] = 1;
      }
    }
  return out;
}

/// From one value of a pose to another: m, rad.
std::pair<double, double> movement(const ParameterTable& table, int parameter, const VectorXd& from,
                                   const VectorXd& to) {
  const int start = table.all[parameter].start;
  const Pose change = inverse(get_pose(from, start)) * get_pose(to, start);
  return {change.translation.norm(), log_so3(change.rotation).norm()};
}

double cost_per_dof(const Solution& s) {
  return s.dof > 0 ? 2 * s.cost / static_cast<double>(s.dof) : 0;
}

}  // namespace

void start_absent_poses(const std::vector<StepPlan>& plans, Solution& solution) {
  const Recording& recording = *solution.recording;
  const ParameterTable& table = recording.table;
  const std::vector<int> unknown = absent_poses_to_find(plans, recording);
  for (size_t i = 0; i < table.all.size(); ++i) {
    const int p = static_cast<int>(i);
    if (!is_pose_of_body(table.all[i]) || is_given(recording.rig, table.all[i]) ||
        std::count(unknown.begin(), unknown.end(), p))
      continue;
    if (how_freed(plans, table, p).at_all) solution.identity_starts.push_back(table.all[i].name);
  }
  for (int p : unknown) solution.computed_starts.push_back(table.all[p].name);
  if (unknown.empty()) return;
  Values started;
  started.shared = solution.initial;
  UnknownStarts starts = start_unknown_poses(recording, recording.training(), unknown, started);
  solution.lost_starts = std::move(starts.lost);
  solution.ambiguous_starts = std::move(starts.ambiguous);
  solution.initial = solution.values.shared = started.shared;
}

std::string lost_start_text(const Solution& solution, const std::string& pose) {
  const ParameterTable& table = solution.table();
  std::string types;         // of sensors that tell no pose
  bool posed = false;        // others see it as well, ...
  bool more_points = false;  // ... and more than three points
  for (const Sample& sample : solution.samples())
    for (const View& v : sample.views) {
      const int target = table.target_pose[v.target];
      if (table.all[table.sensor_pose[v.sensor]].name != pose &&
          (target < 0 || table.all[target].name != pose))
        continue;
      const Sensor& sensor = solution.rig().sensors[v.sensor];
      const MeasurementKind kind = sensor.model->measurement_kind();
      if (kind == MeasurementKind::none && types.find(sensor.type) == std::string::npos)
        types += (types.empty() ? "" : ", ") + sensor.type;
      posed = posed || kind != MeasurementKind::none;
      more_points = more_points || kind != MeasurementKind::rays || v.ids.size() > 3;
    }
  const std::string absent = pose + " is missing in the rig and ";
  if (!posed && !types.empty())
    return absent + "a sensor of type " + types +
           " gives no pose to start from: it starts at the identity, and the result may be wrong; "
           "give it a pose in the rig";
  if (solution.status == Status::converged) return "";
  if (posed && !more_points)
    return absent +
           "is seen only by views of at most three points, and each view fits several poses: it "
           "starts at the identity. Use a board or a fourth point, or give it a rough pose in the "
           "rig";
  return absent +
         "nothing with a known pose ties it down: it starts at the identity. Give it, or "
         "a pose that it hangs on, in the rig";
}

bool ended_badly(const Solution& solution) {
  return solution.status == Status::undefined_start || solution.status == Status::not_converged ||
         cost_per_dof(solution) > kPoor;
}

bool start_given_poses(const std::vector<StepPlan>& plans, const Solution& first,
                       Solution& solution) {
  const Recording& recording = *solution.recording;
  const ParameterTable& table = recording.table;
  const std::vector<GivenPose> given = given_poses(plans, recording);
  if (given.empty()) return false;
  const std::vector<int> absent = absent_poses_to_find(plans, recording);
  std::vector<int> unknown = absent;
  for (const GivenPose& g : given) {
    unknown.push_back(g.body);
    if (g.proxy) unknown.insert(unknown.end(), g.proxy->others.begin(), g.proxy->others.end());
  }
  std::sort(unknown.begin(), unknown.end());
  unknown.erase(std::unique(unknown.begin(), unknown.end()), unknown.end());
  Values started;
  started.shared = solution.initial;
  UnknownStarts starts = start_unknown_poses(recording, recording.training(), unknown, started);
  for (const GivenPose& g : given)
    if (g.proxy) move_origin(table, *g.proxy, solution.initial, started.shared);
  bool elsewhere = first.status == Status::undefined_start;
  for (const GivenPose& g : given) {
    const auto [moved, turned] = movement(table, g.parameter, first.values.shared, started.shared);
    elsewhere = elsewhere || moved > kElsewhere || turned > kElsewhere;
  }
  for (const int p : absent) {  // which a wrong given pose may have put where they stayed
    const auto [moved, turned] = movement(table, p, first.values.shared, started.shared);
    elsewhere = elsewhere || moved > kElsewhere || turned > kElsewhere;
  }
  if (!elsewhere) return false;
  solution.identity_starts = first.identity_starts;
  for (int p : absent) {
    const std::string& name = table.all[p].name;
    solution.computed_starts.push_back(name);
    if (std::count(starts.lost.begin(), starts.lost.end(), name))
      solution.lost_starts.push_back(name);
    set_pose(solution.initial, table.all[p].start, get_pose(started.shared, table.all[p].start));
  }
  solution.ambiguous_starts = std::move(starts.ambiguous);
  solution.values.shared = started.shared;
  return true;
}

bool decisively_better(const Solution& again, const Solution& first) {
  if (again.status == Status::undefined_start) return false;
  if (first.status == Status::undefined_start) return again.usable();
  return kPoor * again.cost < first.cost;
}

void name_replaced_starts(const std::vector<StepPlan>& plans, const Solution& first,
                          Solution& solution) {
  const ParameterTable& table = solution.table();
  for (const GivenPose& g : given_poses(plans, *solution.recording)) {
    const auto [moved, turned] =
        movement(table, g.parameter, table.initial, solution.values.shared);
    if (moved < pose_scales("m").reported && turned < pose_scales("rad").reported) continue;
    solution.replaced_starts.push_back(
        {table.all[g.parameter].name, moved, turned,
         first.status == Status::undefined_start ? 0.0 : cost_per_dof(first)});
  }
}

}  // namespace kincal
