// Cross-validation: as many calibrations as folds (models/rig/folds.h), each judged on the fold
// that it lacks.
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../analysis/held_out.h"
#include "../calibration/calibration.h"

namespace kincal {

struct CrossValidation {
  struct Fold {
    std::vector<std::string> held_out;  // blocks
    bool converged = false, determined = false;
    std::string error;  // why there is no calibration without this fold; its views are missing
  };
  bool by_target = false;
  std::vector<Fold> folds;
  std::vector<std::string> never;  // blocks that are never held out
  std::vector<HeldOutError> sensors;
};
/// Calibrates the training samples from the rig's values as often as there are folds, each time
/// without one fold, and judges it on that fold. Samples that are held out already take no part.
/// nullopt: options.progress cancelled.
/// @throws std::invalid_argument as deal_folds.
std::optional<CrossValidation> cross_validate(const std::shared_ptr<const Recording>& recording,
                                              const CalibrationOptions& options, int folds);

}  // namespace kincal
