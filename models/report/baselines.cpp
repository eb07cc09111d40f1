#include "baselines.h"

#include <algorithm>
#include <cmath>
#include <map>

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

/// Squares of one sensor's residuals by three calibrations.
struct ThreeSquares {
  double rig = 0, mounts = 0, automatic = 0;
};

/// One row, of translations or of rotations; `parts` are by block.
Baseline baseline_row(const std::map<int, ThreeSquares>& parts, long points) {
  Baseline out;
  std::vector<double> automatic, mounts;
  ThreeSquares total;
  for (const auto& part : parts) {
    total.rig += part.second.rig;
    total.mounts += part.second.mounts;
    total.automatic += part.second.automatic;
    mounts.push_back(part.second.mounts);
    automatic.push_back(part.second.automatic);
  }
  const auto n = static_cast<double>(points);
  out.points = points;
  out.blocks = static_cast<long>(parts.size());
  out.rig = std::sqrt(total.rig / n);
  out.mounts = std::sqrt(total.mounts / n);
  out.automatic = std::sqrt(total.automatic / n);
  out.ratio = out.automatic / out.mounts;
  out.of_ratio = rms_ratio_interval(automatic, mounts);
  return out;
}

/// The sums of a sensor's residuals in a sample, if they are of as many points.
const BlockSums* same_points(const HeldOutSums& sums, const std::pair<int, int>& of, long points) {
  const auto found = sums.all.find(of);
  return found != sums.all.end() && found->second.points == points ? &found->second : nullptr;
}

/// The rows of one sensor: none, one, or two.
void add_rows(const Rig& rig, int sensor, const Blocks& blocks, const BaselineSums& sums,
              std::vector<Baseline>& out) {
  using Squares = double BlockSums::*;
  for (Squares squares : {&BlockSums::as_read, &BlockSums::rotation_as_read}) {
    const bool rotation = squares == &BlockSums::rotation_as_read;
    if (rotation && !rig.sensors[sensor].model->measures_pose()) continue;
    std::map<int, ThreeSquares> by_block, by_sample;
    long points = 0;
    bool by_target = false;
    for (const auto& entry : sums.automatic.all) {
      if (entry.first.first != sensor) continue;
      const int sample = entry.first.second;
      const long here = entry.second.points;
      const BlockSums* mounts = same_points(sums.mounts, entry.first, here);
      if (!mounts) continue;
      const BlockSums* as_it_is = same_points(sums.rig, entry.first, here);
      points += here;
      by_target = by_target || blocks.target[blocks.of[sample]];
      for (ThreeSquares* to : {&by_block[blocks.of[sample]], &by_sample[sample]}) {
        to->rig += as_it_is ? as_it_is->*squares : kNan;
        to->mounts += mounts->*squares;
        to->automatic += entry.second.*squares;
      }
    }
    if (points == 0) return;
    const bool whole = by_block.size() >= 3;
    Baseline row = baseline_row(whole ? by_block : by_sample, points);
    row.sensor = rig.sensors[sensor].name;
    row.unit = rotation ? "rad" : rig.sensors[sensor].model->unit();
    row.by_target = whole && by_target;
    out.push_back(row);
  }
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
  for (size_t s = 0; s < rig.sensors.size(); ++s)
    add_rows(rig, static_cast<int>(s), blocks, sums, out);
  return out;
}

bool gives_poses(const Rig& rig) {
  return std::any_of(rig.sensors.begin(), rig.sensors.end(),
                     [](const Sensor& s) { return s.pose_given; }) ||
         std::any_of(rig.targets.begin(), rig.targets.end(),
                     [](const Target& t) { return t.link >= 0 && t.pose_given; });
}

}  // namespace kincal
