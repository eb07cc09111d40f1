#include "cross_validation.h"

#include <algorithm>
#include <cmath>

#include "../analysis/linearisation.h"

namespace kincal {

Cleaned fit_all(const std::shared_ptr<const Recording>& recording,
                const CalibrationOptions& options) {
  return {uncancelled(calibrate(recording, options)), {}, "", indices(recording->samples.size())};
}

Cleaned fit_without_outliers(const std::shared_ptr<const Recording>& recording,
                             const CalibrationOptions& options) {
  return uncancelled(calibrate_without_outliers(recording, options));
}

std::optional<CrossValidation> cross_validate(const std::shared_ptr<const Recording>& recording,
                                              const CalibrationOptions& options, int count,
                                              const FoldFit& fit, const FoldJudge& also) try {
  const Folds folds = deal_folds(recording->rig, recording->samples, count);
  CrossValidation out;
  out.by_target = folds.by_target();
  out.never = folds.held_out(-1);
  HeldOutSums& sums = out.sums;
  for (int f = 0; f < count; ++f) {
    options.progress.stage("cross-validation", static_cast<double>(f) / count);
    std::vector<Sample> samples;
    std::vector<int> index;
    for (int i : recording->training()) {
      samples.push_back(recording->samples[i]);
      samples.back().train = folds.of[i] != f;
      index.push_back(i);
    }
    CalibrationOptions fold_options = options;
    fold_options.progress =
        options.progress.in("fold " + std::to_string(f + 1) + " of " + std::to_string(count));
    CrossValidation::Fold fold;
    fold.held_out = folds.held_out(f);
    const auto leave_out = [&](const std::string& error) {
      fold.error = error;
      for (int i : recording->training())
        if (folds.of[i] == f)
          for (const View& v : recording->samples[i].views) ++sums.missing[v.sensor];
    };
    try {
      const std::shared_ptr<const Recording> without =
          make_recording(recording->with_samples(std::move(samples)));
      check_steps(*without);
      const Cleaned clean = fit(without, fold_options);
      const Solution& solution = clean.solution;
      if (solution.status == Status::undefined_start) {
        leave_out(solution.message);
      } else {
        fold.converged = solution.status != Status::not_converged;
        fold.determined = solution.unobservable.empty();
        fold.rejected = clean.rejected;
        std::vector<int> place;
        for (int i : clean.kept) place.push_back(index[i]);
        const Residuals found = residuals(linearise(solution));
        fold.judged =
            std::none_of(found.unfinished.begin(), found.unfinished.end(),
                         [](const Unfinished& u) { return !u.train && u.column != "rms_before"; });
        sums.add(*solution.recording, found, place);
        if (also) also(solution, place);
      }
    } catch (const std::exception& error) {
      leave_out(error.what());
    }
    out.folds.push_back(std::move(fold));
  }
  options.progress.stage("cross-validation", 1);
  out.blocks = folds.blocks;
  out.sensors = held_out_errors(recording->rig, out.blocks, sums);
  return out;
} catch (const Cancelled&) {
  return std::nullopt;
}

HeldOutBlocks blocks(const CrossValidation& held_out) {
  HeldOutBlocks out;
  for (const auto& [place, sums] : held_out.sums.all) {
    out[place.second].first += sums.squared;
    out[place.second].second += sums.points;
  }
  return out;
}

double rms_of(const HeldOutBlocks& blocks) {
  double squares = 0, points = 0;
  for (const auto& [sample, block] : blocks) {
    squares += block.first;
    points += static_cast<double>(block.second);
  }
  return std::sqrt(squares / points);
}

std::pair<double, double> worse_by(const HeldOutBlocks& one, const HeldOutBlocks& other) {
  std::vector<double> without;
  for (const auto& [sample, block] : one) {
    HeldOutBlocks a = one, b = other;
    a.erase(sample), b.erase(sample);
    without.push_back(rms_of(a) - rms_of(b));
  }
  const auto m = static_cast<double>(without.size());
  double mean = 0, variance = 0;
  for (double d : without) mean += d / m;
  for (double d : without) variance += (d - mean) * (d - mean);
  return {rms_of(one) - rms_of(other), std::sqrt(variance * (m - 1) / m)};
}

}  // namespace kincal
