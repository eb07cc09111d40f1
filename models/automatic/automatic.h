// The automatic path: a recording whose rig has no steps is calibrated with everything free that
// could be wrong (groups.h), the widths of what is assumed about it learned from the data
// (widths.h), and what there is no evidence for put back to its nominal value.
//
//   1. The mounts alone, from the data where the rig leaves them open.
//   2. Everything, with the groups' starting widths. The widths are learned at that linearisation,
//      everything is estimated again, and so on until they stay (two or three times). So is the
//      noise of sensors and joints that nobody states (analysis/noise_levels.h).
//   3. Groups and numbers without evidence are held; what is left is estimated once more: steps
//      `mounts` and `everything`, which the solution has, with the widths as priors.
//
// Errors are predicted from the second moment of all numbers, held ones and those that no
// measurement sees included (Solution::prediction); sigmas are its roots.
#pragma once

#include <string>
#include <vector>

#include "outcome.h"

namespace kincal {

/// Returns the values that the widths of a solution's numbers count from, of the parameters that it
/// changed.
std::vector<NominalValue> nominal_values(const Solution& solution);

/// Returns in words why a component was fixed, and its uncertainty.
std::string held_text(const AutomaticNumber& number);

/// Returns the rig's steps at the starting widths: what runs before anything is learned.
/// @throws as make_groups().
std::vector<Step> automatic_steps(const Recording& recording, const AutomaticOptions& options);

/// Calibrates a recording; the steps of its rig are ignored. Further models from an earlier
/// calibration are tested again, unless `begin` lists the ones to keep. The solution's status is
/// the outcome. @throws as make_groups() and calibrate().
AutomaticCalibration calibrate_automatically(const Recording& recording,
                                             const AutomaticOptions& options);

/// Returns where a calibration of the solution's recording with other noise begins.
Begin begin_at(const Solution& solution, const std::vector<AutomaticGroup>& groups);

/// Passes one on that was not cancelled. @throws Cancelled
inline AutomaticCalibration uncancelled(AutomaticCalibration found) {
  if (found.solution.status == Status::cancelled) throw Cancelled();
  return found;
}

}  // namespace kincal
