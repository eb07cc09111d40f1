// Cross-validation: as many calibrations as folds (models/rig/folds.h), each judged on the fold
// that it lacks.
//
// With fit_without_outliers every calibration takes gross outliers out of its own training samples
// (outliers.h) and is judged on everything of its fold, outliers included: what is judged must not
// decide what it is judged on, and a robot in use does not know its outliers beforehand. They weigh
// on the root mean square; the median beside it they leave alone.
#pragma once

#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "../analysis/held_out.h"
#include "outliers.h"

namespace kincal {

struct CrossValidation {
  struct Fold {
    std::vector<std::string> held_out;  // blocks
    bool converged = false, determined = false;
    bool judged = false;  // and what its held-out samples have of their own converged as well
    std::vector<Rejected> rejected;  // of the other folds
    std::string error;  // why there is no calibration without this fold; its views are missing
  };
  bool by_target = false;
  bool reject = false;  // the caller's: `fit` took gross outliers out of the training of each fold
  std::vector<Fold> folds;
  std::vector<std::string> never;  // blocks that are never held out
  std::vector<HeldOutError> sensors;
  HeldOutSums sums;  // that they are made of
  Blocks blocks;
};

/// It is called for each calibration that could be judged, with the places of its samples in the
/// whole set. It may throw Cancelled.
using FoldJudge = std::function<void(const Solution&, const std::vector<int>&)>;

/// How the training samples of a fold are calibrated. It may throw Cancelled.
using FoldFit =
    std::function<Cleaned(const std::shared_ptr<const Recording>&, const CalibrationOptions&)>;
Cleaned fit_all(const std::shared_ptr<const Recording>& recording,
                const CalibrationOptions& options);
Cleaned fit_without_outliers(const std::shared_ptr<const Recording>& recording,
                             const CalibrationOptions& options);

/// Calibrates the training samples once per fold from the rig's values, each time without one fold,
/// and tests the result on that fold. Samples that are already held out are not used. nullopt:
/// cancelled. @throws std::invalid_argument as deal_folds.
std::optional<CrossValidation> cross_validate(const std::shared_ptr<const Recording>& recording,
                                              const CalibrationOptions& options, int folds,
                                              const FoldFit& fit = fit_all,
                                              const FoldJudge& also = nullptr);

/// HeldOutBlocks are squares and points held out, by sample.
using HeldOutBlocks = std::map<int, std::pair<double, long>>;
HeldOutBlocks blocks(const CrossValidation& held_out);
/// Returns their root mean square.
double rms_of(const HeldOutBlocks& blocks);
/// Returns by how much the root mean square of the one is above that of the other, both of the same
/// samples, and the standard error of that: the jackknife over samples, paired.
std::pair<double, double> worse_by(const HeldOutBlocks& one, const HeldOutBlocks& other);

}  // namespace kincal
