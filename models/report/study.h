// A study: a recording calibrated with everything that was asked for, in the order that makes it
// right, and all that is to be known of the result.
//
//   1. A rig without steps is calibrated automatically (automatic/automatic.h) where this says
//      calibrated.
//   2. Gross outliers are taken out (trials/outliers.h), on the automatic path at its starting
//      widths.
//   3. Sigmas are estimated (trials/estimate_noise.h).
//   4. What is left is calibrated, and analysed: residuals, noise, weak directions, leverage,
//   samples that stick out, loops. After a fit that
//      ended badly outliers are named.
//   5. Trials that judge it: restarts, held-out errors, cross-validation, predicted errors of
//   frames, tolerances.
//   6. Where it ended badly, mistakes in the input are looked for (doctor/doctor.h).
//   7. Whether the model explains the data, warnings and the verdict, when all of this is known.
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
  GroupChoice groups;  // of a rig without steps
  bool reject = false, estimate_noise = false;
  int restarts = 0;        // how many; 0: none
  int cross_validate = 0;  // folds; 0: none
  bool loops = true;
  bool diagnose = false;  // look for mistakes if it ended badly; else only where the status of a
                          // whole run depends on what is found (kMistaken in verdict.h)
  std::vector<std::string> held_out;  // blocks that were taken out of the training, for the record
  std::vector<Frame> frames;  // whose predicted error is reported; those of requirements among them
  std::vector<Requirement> requirements;
};

/// Above this chi2/dof a result asks for an explanation.
constexpr double kUnexplained = 5;

/// Runs a study. The report's solution may have any status but cancelled; with undefined_start only
/// the diagnosis is there besides. nullopt: cancelled.
/// @throws NameError, std::invalid_argument as calibrate(), make_groups(), deal_folds(),
/// estimate_noise().
std::optional<Report> study(const std::shared_ptr<const Recording>& recording,
                            const StudyOptions& options);

}  // namespace kincal
