// The automatic path: if the rig has no steps, every parameter that may be wrong is estimated
// (groups.h). Prior widths are learned from the data (widths.h), and parameters without evidence of
// error are reset to their nominal values.
//
//   1. The mounts alone; those absent from the rig start from the data.
//   2. Everything, with the groups' starting widths. The widths are learned at that linearisation,
//      everything is estimated again, and so on until they no longer change (two or three times).
//      Noise of sensors and joints that is not stated is learned likewise
//      (analysis/noise_levels.h).
//   3. Groups and components without evidence are fixed; the rest is estimated once more: steps
//      `mounts` and `everything`, which the solution has, with the widths as priors.
//
// Errors are predicted from the second moment of all components, including fixed ones and those on
// which no measurement depends (Solution::prediction), with another lens and errors of flange poses
// that depend on the pose; sigmas are its roots.
#pragma once

#include <string>
#include <vector>

#include "outcome.h"

namespace kincal {

/// Returns the nominal values of the parameters that a solution changed; its prior widths are
/// relative to these.
std::vector<NominalValue> nominal_values(const Solution& solution);

/// Returns a text with the reason why a component was fixed, and its uncertainty.
std::string held_text(const AutomaticNumber& number);

/// Returns the steps with the starting widths, before any width is learned.
/// @throws as make_groups().
std::vector<Step> automatic_steps(const Recording& recording, const AutomaticOptions& options);

/// Calibrates a recording; the steps of its rig are ignored. Further models from an earlier
/// calibration are tested again, unless `begin` lists the ones to keep. The solution's status is
/// the outcome. @throws as make_groups() and calibrate().
AutomaticCalibration calibrate_automatically(const Recording& recording,
                                             const AutomaticOptions& options);

/// Returns the start of another calibration of the solution's recording with other noise.
Begin begin_at(const Solution& solution, const std::vector<AutomaticGroup>& groups);

/// Returns the calibration. @throws Cancelled if it was cancelled
inline AutomaticCalibration uncancelled(AutomaticCalibration found) {
  if (found.solution.status == Status::cancelled) throw Cancelled();
  return found;
}

}  // namespace kincal
