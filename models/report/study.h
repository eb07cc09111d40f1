// A study: the calibration of a recording with all requested trials and analyses, in the right
// order.
//
// If the rig has no steps, calibrations are automatic (automatic/automatic.h).
//   1. Gross outliers are removed (trials/outliers.h), on the automatic path at its starting
//   widths.
//   2. Sigmas are estimated (trials/estimate_noise.h).
//   3. The remaining data are calibrated and analysed: residuals, noise, weak directions, leverage,
//      outliers, loops. After a fit that ended badly, outliers of a robust fit are named.
//   4. Trials judge the result: restarts, held-out errors, cross-validation, predicted errors of
//      frames, tolerances.
//   5. If it ended badly, mistakes in the input are sought (doctor/doctor.h).
//   6. Finally: whether the model explains the data, warnings, and the verdict.
#pragma once

#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "../calibration/calibration.h"
#include "report.h"

namespace kincal {

struct StudyOptions {
  CalibrationOptions calibration;
  GroupChoice groups;  // if the rig has no steps
  bool reject = false, estimate_noise = false;
  int restarts = 0;        // their number; 0: none
  int cross_validate = 0;  // folds; 0: none
  bool loops = true;
  bool diagnose = false;  // seek mistakes if it ended badly; else only if the status of the
                          // run depends on a finding (kMistaken in verdict.h)
  std::vector<std::string> held_out;  // blocks removed from training, for the record
  std::vector<std::string> frames;    // names (analysis/frames.h) of those whose predicted error is
                                      // reported; those of requirements among them
  std::vector<Requirement> requirements;
};

/// A result with chi2/dof above this needs an explanation.
constexpr double kUnexplained = 5;

/// Runs a study. The report's solution may have any status but cancelled; with undefined_start it
/// is accompanied only by the diagnosis. nullopt: cancelled.
/// @throws NameError, std::invalid_argument as calibrate(), make_groups(), deal_folds(),
/// estimate_noise().
std::optional<Report> study(const std::shared_ptr<const Recording>& recording,
                            const StudyOptions& options);

}  // namespace kincal
