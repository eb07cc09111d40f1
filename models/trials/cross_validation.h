// Cross-validation: one calibration per fold (models/rig/folds.h), each judged on the fold that it
// lacks.
//
// With fit_without_outliers every calibration removes gross outliers from its own training samples
// (outliers.h) and is judged on its whole fold, outliers included: a calibration must not select
// the data that judge it, and a robot in use cannot identify its outliers in advance. They enlarge
// the root mean square; the median beside it is hardly affected.
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
    bool judged = false;             // and the private unknowns of its held-out samples converged
    std::vector<Rejected> rejected;  // of the other folds
    std::string
        error;  // reason why there is no calibration without this fold; its views are missing
  };
  bool by_target = false;
  bool reject = false;  // set by the caller: `fit` removed gross outliers from each fold's training
  std::vector<Fold> folds;
  std::vector<std::string> never;  // blocks that are never held out
  std::vector<HeldOutError> sensors;
  HeldOutSums sums;  // the sums behind `sensors`
  Blocks blocks;
};

/// Called for each calibration that could be judged, with the indices of its samples in the whole
/// set. It may throw Cancelled.
using FoldJudge = std::function<void(const Solution&, const std::vector<int>&)>;

/// Calibrates the training samples of a fold. It may throw Cancelled.
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

/// HeldOutBlocks are sums of squares and counts of held-out points, by sample.
using HeldOutBlocks = std::map<int, std::pair<double, long>>;
HeldOutBlocks blocks(const CrossValidation& held_out);
/// Returns their root mean square.
double rms_of(const HeldOutBlocks& blocks);
/// Returns the excess of one root mean square over the other on the same samples, and its standard
/// error by a paired jackknife over samples.
std::pair<double, double> worse_by(const HeldOutBlocks& one, const HeldOutBlocks& other);

}  // namespace kincal
