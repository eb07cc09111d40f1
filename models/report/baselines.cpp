#include "baselines.h"

#include <algorithm>

#include "../analysis/residuals.h"
#include "../rig/selection.h"

namespace kincal {
namespace {

/// Calibrations with steps of the automatic path, or of open poses: nothing of the options' own is
/// free or held.
CalibrationOptions options_of_steps(const CalibrationOptions& options) {
  CalibrationOptions out = options;
  out.free.clear();
  out.fix.clear();
  out.last_step.clear();
  return out;
}

/// The rig as it is, with the samples of a solution.
Solution as_given(const Rig& given, const Solution& solution, const CalibrationOptions& options) {
  std::shared_ptr<const Recording> recording = make_recording(solution.recording->with_rig(given));
  Step step;
  step.name = "open poses";
  step.sensors = indices(given.sensors.size());
  for (int p : open_poses(given, recording->table))
    step.free.push_back(recording->table.all[p].name);
  if (!step.free.empty()) {
    StepVariations once;  // it fits badly: that is no reason to try other starts
    once.before_step = [](const StepPlan&, const VectorXd&, VectorXd&) {};
    return uncancelled(calibrate(with_steps(*recording, {step}), options_of_steps(options), once));
  }
  Solution out;
  out.initial = out.values.shared = recording->table.initial;
  out.recording = std::move(recording);
  return out;
}

}  // namespace

void add_baselines(const Rig& given, const Solution& solution, const VectorXd& mounts,
                   const CalibrationOptions& options, const std::vector<int>& index,
                   BaselineSums& sums) {
  sums.mounts.add(*solution.recording, held_out_as_read(solution, mounts), index);
  if (!gives_poses(given)) return;
  const Solution rig = as_given(given, solution, options);
  if (rig.status != Status::undefined_start)
    sums.rig.add(*rig.recording, held_out_as_read(rig, rig.values.shared), index);
}

std::optional<VectorXd> mounts_alone(const Solution& solution, const CalibrationOptions& options) {
  const std::vector<Step>& steps = solution.rig().steps;
  if (steps.size() < 2) return solution.initial;  // no mount is free
  CalibrationOptions mounts = options_of_steps(options);
  mounts.last_step = steps.front().name;
  StepVariations near;  // the mounts that the whole calibration found are a good start
  near.start = solution.initial;
  for (const Parameter& p : solution.table().all)
    if (p.pose && std::count(steps[0].free.begin(), steps[0].free.end(), p.name))
      near.start->segment(p.start, 12) = solution.values.shared.segment(p.start, 12);
  const Solution found = uncancelled(calibrate(solution.recording, mounts, near));
  if (!found.usable() && found.status != Status::not_converged) return std::nullopt;
  return found.values.shared;
}

std::vector<Baseline> compare_baselines(const Rig& rig, const Blocks& blocks,
                                        const BaselineSums& sums) {
  std::vector<Baseline> out;
  for (const ComparedError& row :
       compare_errors(rig, blocks, {&sums.rig, &sums.mounts, &sums.automatic}, 1)) {
    Baseline one{row.sensor, row.unit, row.points, row.blocks, row.by_target};
    one.rig = row.rms[0];
    one.mounts = row.rms[1];
    one.automatic = row.rms[2];
    one.ratio = one.automatic / one.mounts;
    one.of_ratio = row.ratio(2, 1);
    out.push_back(std::move(one));
  }
  return out;
}

bool gives_poses(const Rig& rig) {
  return std::any_of(rig.sensors.begin(), rig.sensors.end(),
                     [](const Sensor& s) { return s.pose_given; }) ||
         std::any_of(rig.targets.begin(), rig.targets.end(),
                     [](const Target& t) { return t.link >= 0 && t.pose_given; });
}

}  // namespace kincal
