#include "outliers.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>

#include "../../solver/decompositions.h"
#include "../analysis/noise_levels.h"
#include "../estimation/estimation.h"
#include "../fitting/robust.h"
#include "../rig/numbers.h"
#include "consensus.h"

namespace kincal {
namespace {

constexpr int kRounds = 8;

/// The samples that are not out as a whole.
std::vector<int> kept_samples(const std::vector<SampleVerdict>& verdicts) {
  std::vector<int> out;
  for (size_t i = 0; i < verdicts.size(); ++i)
    if (!verdicts[i].out) out.push_back(static_cast<int>(i));
  return out;
}

std::vector<Sample> all_without_rejected(const Recording& recording,
                                         const std::vector<SampleVerdict>& verdicts) {
  std::vector<Sample> out;
  for (int i : kept_samples(verdicts))
    out.push_back(verdicts[i].clean()
                      ? recording.samples[i]
                      : without_rejected(recording.rig, recording.samples[i], verdicts[i]));
  return out;
}

void describe(const Recording& recording, const std::vector<SampleVerdict>& verdicts,
              std::vector<Rejected>& out) {
  const Rig& rig = recording.rig;
  for (size_t i = 0; i < verdicts.size(); ++i) {
    const Sample& sample = recording.samples[i];
    const SampleVerdict& verdict = verdicts[i];
    if (verdict.out) out.push_back({sample.id, "", "", {}, verdict.reason});
    for (size_t v = 0; !verdict.out && v < sample.views.size(); ++v) {
      const View& view = sample.views[v];
      Rejected r{sample.id,
                 rig.sensors[view.sensor].name,
                 rig.targets[view.target].name,
                 {},
                 verdict.view_reason[v]};
      for (size_t b = 0; !verdict.view[v] && b < verdict.point[v].size(); ++b)
        if (verdict.point[v][b])
          r.ids.push_back(view.ids.empty() ? static_cast<int>(b) : view.ids[b]);
      if (!r.ids.empty())
        r.reason = "far from where the view's other points put " +
                   std::string(r.ids.size() == 1 ? "it" : "them");
      if (verdict.view[v] || !r.ids.empty()) out.push_back(r);
    }
  }
}

/// Raises the joints' sigmas of `judged` to what is seen in a fit with them, where that is clearly
/// more than is stated; true: it raised some.
bool raise_joint_noise(const Rig& stated, const Solution& fit, Rig& judged) {
  constexpr double kClearly = 1.5, kMore = 1.1;
  const std::vector<double> ratios =
      robust_joint_ratios(*fit.last->problem, fit.rig(), fit.last->state);
  bool raised = false;
  for (size_t j = 0; j < ratios.size(); ++j) {
    const double before = judged.joints[j].sigma, seen = before * ratios[j];
    if (before == 0 || seen < kClearly * stated.joints[j].sigma || seen < kMore * before) continue;
    judged.joints[j].sigma = seen;
    raised = true;
  }
  return raised;
}

/// True if a joint would be so noisy that its readings are wrong instead.
bool beyond_noise(const Rig& stated, const Rig& judged) {
  constexpr double kMost = 50;
  for (size_t j = 0; j < judged.joints.size(); ++j)
    if (judged.joints[j].sigma > kMost * stated.joints[j].sigma) return true;
  return false;
}

/// The graduated fit of everything; `judged` becomes the rig with the joints' noise that is seen.
Solution fit_everything(const std::shared_ptr<const Recording>& recording,
                        const CalibrationOptions& options, Rig& judged) {
  const Rig& stated = recording->rig;
  StepVariations robust;
  robust.robust = true;
  Solution fit = uncancelled(calibrate(recording, options, robust));
  for (int round = 0; round < kRounds && fit.status != Status::undefined_start; ++round) {
    if (!raise_joint_noise(stated, fit, judged)) return fit;
    const bool wrong = beyond_noise(stated, judged);
    if (wrong) judged = stated;
    fit = uncancelled(calibrate(make_recording(recording->with_rig(judged)), options, robust));
    if (wrong) return fit;
  }
  return fit;
}

/// Nothing is taken out: the plain calibration, and why.
Cleaned without_consensus(const std::shared_ptr<const Recording>& recording,
                          const CalibrationOptions& options, long out, size_t of) {
  Cleaned plain{
      uncancelled(calibrate(recording, options)), {}, "", indices(recording->samples.size())};
  plain.no_consensus = std::to_string(out) + " of " + std::to_string(of) +
                       " samples do not fit the others: nothing was removed";
  if (plain.solution.status == Status::undefined_start)
    plain.solution.message =
        plain.no_consensus + ", and the plain fit cannot start: " + plain.solution.message;
  return plain;
}

}  // namespace

std::optional<Cleaned> calibrate_without_outliers(const std::shared_ptr<const Recording>& recording,
                                                  const CalibrationOptions& options) try {
  const Rig& rig = recording->rig;
  const std::vector<Sample>& samples = recording->samples;
  const std::vector<int> training = recording->training();
  CalibrationOptions quick = options;  // to find them
  quick.noise = NoiseMode::latent;
  quick.progress = options.progress.in("looking for outliers");
  Rig judged = rig;
  Solution fit = fit_everything(recording, quick, judged);
  if (fit.status == Status::undefined_start) return Cleaned{std::move(fit), {}, "", {}};
  ReferenceFit reference{recording->with_rig(judged),
                         fit.setup.sensors,
                         fit.values.shared,
                         fit.setup.noise_ratios,
                         {},
                         {},
                         quick.progress};
  std::vector<Values> start(samples.size());
  for (const auto& t : fit.values.targets)
    start[t.first.first].targets[{0, t.first.second}] = t.second;

  std::vector<SampleVerdict> verdicts;
  for (const Sample& s : samples) verdicts.push_back(nothing_rejected(rig, s));
  std::vector<char> returned(samples.size(), 0);  // what came back once and is out again stays out
  for (int round = 0; round < kRounds; ++round) {
    const Progress progress = quick.progress.in("round " + std::to_string(round + 1));
    const std::vector<SampleVerdict> before = verdicts;
    for (size_t k = 0; k < training.size(); ++k) {
      progress.share(static_cast<double>(k), static_cast<double>(training.size()));
      const int i = training[k];
      if (before[i].took_part()) {
        verdicts[i] = judge_sample(reference, samples[i], before[i], start[i]);
      } else if (!returned[i]) {
        verdicts[i] = judge_sample(reference, samples[i], before[i], start[i]);
        returned[i] = verdicts[i].took_part();
      }
    }
    const auto out = std::count_if(verdicts.begin(), verdicts.end(),
                                   [](const SampleVerdict& v) { return v.out; });
    if (2 * out > static_cast<long>(training.size()))
      return without_consensus(recording, options, out, training.size());
    if (round > 0 && verdicts == before) break;
    const std::shared_ptr<const Recording> left =
        make_recording(reference.given.with_samples(all_without_rejected(*recording, verdicts)));
    check_steps(*left);
    fit = uncancelled(calibrate(left, quick));
    if (fit.status == Status::undefined_start) return Cleaned{std::move(fit), {}, "", {}};
    reference.noise_ratios =
        robust_noise_ratios(rig, fit.last->problem->residuals(fit.last->state));
    reference.shared = fit.values.shared;
    reference.free = fit.setup.free;
    reference.root = std::sqrt(fit.dof_data > 0 ? std::max(1.0, fit.chi2_per_dof()) : 1.0) *
                     root_of_covariance(fit.covariance);
  }
  const std::shared_ptr<const Recording> left =
      make_recording(recording->with_samples(all_without_rejected(*recording, verdicts)));
  check_steps(*left);
  Cleaned clean{uncancelled(calibrate(left, options)), {}, "", kept_samples(verdicts)};
  describe(*recording, verdicts, clean.rejected);
  return clean;
} catch (const Cancelled&) {
  return std::nullopt;
}

std::optional<std::vector<Rejected>> find_outliers(
    const std::shared_ptr<const Recording>& recording, const CalibrationOptions& options) {
  try {
    std::optional<Cleaned> clean = calibrate_without_outliers(recording, options);
    if (!clean) return std::nullopt;
    if (clean->solution.status == Status::undefined_start) return std::vector<Rejected>();
    return std::move(clean->rejected);
  } catch (const std::exception&) {  // what is left frees nothing: no names
    return std::vector<Rejected>();
  }
}

}  // namespace kincal
