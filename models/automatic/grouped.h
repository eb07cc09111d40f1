// One calibration of the automatic path, with a set of groups: 1 to 3 of automatic.h.
#pragma once

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "further.h"
#include "outcome.h"

namespace kincal {

/// Returns the groups of a recording, without what `fix` names.
AutomaticGroups groups_of(const Recording& recording, const AutomaticOptions& options);
/// Returns steps with the groups at these factors, without what is held.
std::vector<Step> steps_of(const Recording& recording, const AutomaticGroups& groups,
                           const VectorXd& factor, const std::vector<Component>& held);
VectorXd start_factors(const AutomaticGroups& groups);

/// A calibration, and what further models are tried on.
struct Calibrated {
  AutomaticCalibration found;
  FitWithGroups fit;
};

/// What is calibrated: a recording, with which groups, and where that begins.
struct Model {
  std::shared_ptr<const Recording> recording;
  AutomaticOptions options;
  std::vector<std::string> further;      // groups of further models in it
  std::map<std::string, double> factor;  // of groups' widths; else 1
  std::optional<Values> start;           // of the fit of everything; else the mounts alone
};

Calibrated calibrate_groups(const Model& model);

}  // namespace kincal
