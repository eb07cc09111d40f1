#include "cross_validation.h"

#include "../calibration/calibration.h"

namespace kincal {

std::optional<CrossValidation> cross_validate(const Calibration& calibration, const CalibrationOptions& options, int count) {
  const Folds folds = deal_folds(calibration.rig(), calibration.samples(), count);
  CrossValidation out;
  out.by_target = folds.by_target();
  out.never = folds.held_out(-1);
  HeldOutSums sums;
  for (int f = 0; f < count; ++f) {
    std::vector<Sample> samples;
    std::vector<int> index;
    for (int i : calibration.training()) {
      samples.push_back(calibration.samples()[i]);
      samples.back().train = folds.of[i] != f;
      index.push_back(i);
    }
    CalibrationOptions fold_options = options;
    fold_options.judge = true;
    if (options.progress)
      fold_options.progress = [&, f](const std::string&, int iteration, double chi2, double damping) {
        return options.progress("fold " + std::to_string(f + 1) + " of " + std::to_string(count), iteration, chi2, damping);
      };
    CrossValidation::Fold fold;
    fold.held_out = folds.held_out(f);
    try {
      Calibration without(calibration.rig(), std::move(samples));
      const std::optional<CalibrationResult> result = without.run(fold_options);
      if (!result) return std::nullopt;
      fold.converged = result->status != Status::not_converged;
      fold.determined = result->unobservable.empty();
      sums.add(without, *result, index);
    } catch (const std::exception& error) {
      fold.error = error.what();
      for (int i : calibration.training())
        if (folds.of[i] == f)
          for (const View& v : calibration.samples()[i].views) ++sums.missing[v.sensor];
    }
    out.folds.push_back(std::move(fold));
  }
  out.sensors = held_out_errors(calibration.rig(), folds.blocks, sums);
  return out;
}

}  // namespace kincal
