// One calibration of the automatic path, with a set of groups: 1 to 3 of automatic.h.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "further.h"
#include "outcome.h"

namespace kincal {

/// Returns the groups of a recording, without what `fix` names; of an elasticity that nobody stated
/// those in `further`.
AutomaticGroups groups_of(const Recording& recording, const AutomaticOptions& options,
                          const std::vector<std::string>& further);
/// Returns steps with the groups at these factors, without what is held.
std::vector<Step> steps_of(const Recording& recording, const AutomaticGroups& groups,
                           const VectorXd& factor, const std::vector<Component>& held);
VectorXd start_factors(const AutomaticGroups& groups);

/// A calibration, and what further models are tried on.
struct Calibrated {
  AutomaticCalibration found;
  FitWithGroups fit;
};

/// What is calibrated: a recording with further models, and where that begins (`options.begin`).
struct Model {
  std::shared_ptr<const Recording> recording;
  AutomaticOptions options;
};

Calibrated calibrate_groups(const Model& model);
/// Sets the sigmas of estimates and of groups' members to those of the prediction.
void set_predicted_sigmas(AutomaticCalibration& found);

}  // namespace kincal
