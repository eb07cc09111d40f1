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
  std::shared_ptr<const Solution> mounts = nullptr;  // with these alone; null: to be estimated
};

/// A LearnedModel has the widths and the noise of a model, 1 and 2 of automatic.h, and the groups
/// that have evidence with these.
struct LearnedModel;
std::shared_ptr<const LearnedModel> learn_model(const Model& model);
bool has_evidence(const LearnedModel& model, const std::string& group);
/// Returns the solution with the mounts alone.
std::shared_ptr<const Solution> mounts_of(const std::shared_ptr<const LearnedModel>& model);
/// Returns the calibration with them, 3 of automatic.h.
Calibrated calibrate_groups(const LearnedModel& model, const AutomaticOptions& options);
/// Sets the sigmas of estimates and of groups' members to those of the prediction.
void set_predicted_sigmas(AutomaticCalibration& found);

}  // namespace kincal
