#include "alternatives.h"

#include <algorithm>
#include <cmath>

#include "../evidence/evidence.h"

namespace kincal {
namespace {

const double kAnywhere = std::log(300.0);  // sigmas: range of a residual of an outlier
const double kOfAKind = std::log(0.01);    // odds of a mistake of one kind beforehand
constexpr double kPoseNear = 0.05, kTurnNear = 5 * kPi / 180;  // m, rad: a given pose

/// The density of given poses where they came out.
double log_poses(const Recording& recording, const TrialFit& fit) {
  const Rig& rig = recording.rig;
  const ParameterTable& table = recording.table;
  double out = 0;
  const auto add = [&](int parameter, bool given) {
    const Freed* freed = parameter < 0 ? nullptr : find_freed(fit.setup.free, parameter);
    if (!given || !freed || !freed->whole(table.all[parameter])) return;
    const int start = table.all[parameter].start;
    const Pose change =
        inverse(get_pose(table.initial, start)) * get_pose(fit.values.shared, start);
    const double moved = change.translation.squaredNorm() / (kPoseNear * kPoseNear),
                 turned = log_so3(change.rotation).squaredNorm() / (kTurnNear * kTurnNear);
    out -= 3.5 * std::log1p(moved + turned);  // (6 + 1) / 2
  };
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    add(table.sensor_mount[s], rig.sensors[s].pose_given);
  for (size_t t = 0; t < rig.targets.size(); ++t)
    if (rig.targets[t].link >= 0) add(table.target_mount[t], rig.targets[t].pose_given);
  return out;
}

/// The effective residuals of all views, as the evidence counts them.
double view_residuals(const ModelEvidence& evidence) {
  double out = 0;
  for (size_t k = 0; k < evidence.kinds.size(); ++k)
    if (evidence.kinds[k].sensor >= 0) out += evidence.numbers(static_cast<Eigen::Index>(k));
  return out;
}

}  // namespace

double log_evidence(const Recording& recording, const TrialContext& context, const Stage& stage,
                    const TrialFit& fit, const Hypothesis* h) {
  TrialOptions options;
  options.iterations = 30;
  options.relative_decrease = 1e-6;
  options.start = &fit.values;
  options.loss = Loss();
  const Stage usual = with_usual_errors(recording, stage);
  const TrialFit freed = trial_fit(recording, context, {usual}, options);
  if (!std::isfinite(freed.chi2) || freed.samples.empty()) return -kInfinity;
  EstimationSetup setup = freed.setup;
  setup.loss = Loss();
  const ModelEvidence found = evidence(recording, freed.samples, setup, freed.values);
  const double unit = h && h->shrinks < 1 ? std::log(h->shrinks) : 0,
               out = found.log + log_poses(recording, freed) +
                     (kAnywhere + unit) * view_residuals(found);
  return std::isfinite(out) ? out : -kInfinity;
}

void tell_alternative(const TrialContext& context, const Hypothesis& h, const Trial& trial,
                      double as_is, size_t alike) {
  const double log = log_evidence(trial.recording, context, trial.stage, trial.fit, &h);
  context.tried->push_back(
      {h.kind, h.where,
       log - as_is + kOfAKind - std::log(static_cast<double>(std::max<size_t>(1, alike)))});
}

}  // namespace kincal
