// Measured and predicted errors of a calibration on other data.
#pragma once

#include <algorithm>
#include <optional>
#include <string>
#include <vector>

#include "../analysis/frames.h"
#include "../analysis/held_out.h"
#include "../trials/cross_validation.h"
#include "baselines.h"
#include "requirements.h"
#include "stages.h"

namespace kincal {

struct Validation {
  std::vector<std::string> held_out;  // blocks removed from training
  std::vector<HeldOutError> test;
  std::optional<CrossValidation> cross_validation;
  std::optional<Baselines> baselines;  // automatic path
  std::optional<StageErrors> stages;   // if joints were found to bend or to have error curves
  std::vector<FrameReport> frames;
  std::vector<Judgement> requirements;

  /// Returns whether all requirements are met.
  bool met() const {
    return std::all_of(requirements.begin(), requirements.end(),
                       [](const Judgement& j) { return j.met; });
  }
};

/// Measures a requirement. The frames of `validation` must contain that of the requirement.
Judgement judge_requirement(const Requirement& requirement, const Validation& validation,
                            const std::vector<SensorResult>& sensors, double chi2_per_dof);

}  // namespace kincal
