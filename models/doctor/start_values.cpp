#include "start_values.h"

#include <algorithm>
#include <cmath>
#include <set>
#include <utility>

#include "../rig/words.h"

namespace kincal {
namespace {

/// A pose that the rig gives, and the one that it may have been meant to be.
struct Suspicion {
  int parameter;
  Subject what;
  Pose given, other;
  std::string mistake, cure;  // clauses without full stop
};

/// How far two poses are from each other: m, rad.
std::pair<double, double> distance(const Pose& a, const Pose& b) {
  const Pose change = inverse(a) * b;
  return {change.translation.norm(), log_so3(change.rotation).norm()};
}

/// The fit with a pose of the rig replaced and held, everything else free.
TrialFit fit_held_at(const Recording& recording, const TrialContext& context, int parameter,
                     const Pose& pose) {
  const Parameter& p = recording.table.all[parameter];
  Rig rig = recording.rig;
  if (p.kind == ParameterKind::sensor_pose) {
    rig.sensors[p.owner].link_T_sensor = pose;
    rig.sensors[p.owner].pose_given = true;
  } else {
    rig.targets[p.owner].link_T_target = pose;
    rig.targets[p.owner].pose_given = true;
  }
  return best_fit(recording.with_rig(std::move(rig)), context, without(context.all, p.name),
                  {60, 1e-4});
}

/// The finding, if the estimate left the given pose behind for the other one and chi2 agrees.
std::optional<Notice> check(const Recording& recording, const TrialContext& context,
                            const TrialFit& now, const Suspicion& suspicion) {
  const Pose estimate = get_pose(now.values.shared, recording.table.all[suspicion.parameter].start);
  const auto far = distance(suspicion.given, estimate), near = distance(suspicion.other, estimate);
  if (far.first < 0.05 && far.second < 0.7) return std::nullopt;
  if (near.first > std::max(0.005, 0.2 * far.first) ||
      near.second > std::max(0.1, 0.2 * far.second))
    return std::nullopt;
  const TrialFit as_given = fit_held_at(recording, context, suspicion.parameter, suspicion.given);
  const TrialFit corrected = fit_held_at(recording, context, suspicion.parameter, suspicion.other);
  if (!corrected.complete() ||
      (as_given.complete() && as_given.cost < Thresholds::decisive * corrected.cost))
    return std::nullopt;
  Notice finding = make_notice(
      NoticeKind::inverted_pose, {suspicion.what},
      suspicion.mistake +
          text(": the estimate is %.3g m and %.3g degrees from the given pose", far.first,
               far.second * 180 / kPi) +
          text(", but only %.3g m and %.3g degrees from this", near.first, near.second * 180 / kPi),
      "with the pose held, chi2 is " +
          (as_given.complete() ? text("%.6g as given", as_given.chi2) : "undefined as given") +
          text(" and %.6g so", corrected.chi2),
      suspicion.cure);
  if (as_given.complete()) finding.chi2_as_is = as_given.chi2;
  finding.chi2_corrected = corrected.chi2;
  return finding;
}

}  // namespace

void check_starts(const Recording& recording, const TrialContext& context, const TrialFit& now,
                  std::vector<Notice>& out) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  const FreedNames freed = freed_names(table, context.all);
  if (now.values.shared.size() != table.initial.size()) return;
  std::vector<Suspicion> suspicions;
  for (size_t s = 0; s < rig.sensors.size(); ++s) {
    const Sensor& sensor = rig.sensors[s];
    if (!sensor.pose_given || log_se3(sensor.link_T_sensor).norm() < 1e-6) continue;
    suspicions.push_back(
        {table.sensor_pose[s], Subject::sensor(sensor.name), sensor.link_T_sensor,
         inverse(sensor.link_T_sensor),
         "the pose of sensor " + quoted(sensor.name) +
             " is given the wrong way round, as sensor_T_link",
         "replace sensors." + sensor.name +
             ".pose by its inverse: it maps coordinates of the sensor to the link's"});
  }
  for (size_t t = 0; t < rig.targets.size(); ++t) {
    const Target& target = rig.targets[t];
    if (target.link < 0 || !target.pose_given) continue;
    suspicions.push_back(
        {table.target_pose[t], Subject::target(target.name), target.link_T_target,
         inverse(target.link_T_target),
         "the pose of target " + quoted(target.name) +
             " is given the wrong way round, as target_T_link",
         "replace targets." + target.name +
             ".mount.pose by its inverse: it maps coordinates of the target to the link's"});
  }
  for (const Suspicion& suspicion : suspicions)
    if (freed.parameter[suspicion.parameter])
      if (std::optional<Notice> finding = check(recording, context, now, suspicion))
        out.push_back(std::move(*finding));
}

std::string joint_noise(const Recording& recording, const TrialContext& context,
                        const TrialFit& now) {
  if (context.noise != NoiseMode::latent) return "";
  std::set<int> joints;
  for (const Sample& s : recording.samples)
    for (const View& v : s.views)
      for (int j : joints_between(recording.rig, v))
        if (recording.rig.sensors[v.sensor].scanning_joint != j) joints.insert(j);
  for (double sigma : {0.0001, 0.0003, 0.001, 0.003, 0.01, 0.03}) {
    Rig rig = recording.rig;
    bool more = false;
    for (int j : joints)
      if (rig.joints[j].sigma < sigma) rig.joints[j].sigma = sigma, more = true;
    if (!more) continue;
    TrialOptions o;
    o.iterations = 60;
    o.relative_decrease = 1e-4;
    o.start = &now.values;
    const TrialFit f = trial_fit(recording.with_rig(std::move(rig)), context, {context.all}, o);
    if (f.per_dof() < Thresholds::good)
      return text(
          "Errors of the joint readings would: with sigma %.3g (rad, m) for every joint chi2/dof "
          "is %.3g. So the readings are that noisy "
          "(say so in the rig: joints), or the robot has another geometry than the rig can "
          "express.",
          sigma, f.per_dof());
  }
  return "";
}

}  // namespace kincal
