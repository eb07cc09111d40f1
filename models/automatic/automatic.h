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

#include "../analysis/gauges.h"
#include "../calibration/calibration.h"
#include "groups.h"
#include "other_models.h"

namespace kincal {

/// An AutomaticNumber is a member of a group as it came out.
struct AutomaticNumber {
  std::string name, unit;
  double value = 0, sigma = 0;  // from its nominal value; of the prediction
  double width = 0;             // of its prior
  double told = 0;              // share of it that the data tell, 1 - C_ii / t_i^2
  bool held = false;            // put back: value is 0

  bool undetermined() const { return told < 0.1; }
};

struct AutomaticGroup {
  std::string name;
  std::vector<AutomaticNumber> numbers, unseen;
  double factor = 1;  // of the starting widths
  double gamma = 0;   // how many numbers the data determine
  double gain = 0;    // log evidence against all of them being nominal
  bool held = false;  // all of them
};

struct AutomaticCalibration {
  Solution solution;                   // its recording has the steps that were run
  VectorXd mounts;                     // shared values with the mounts alone estimated, as `groups`
  std::vector<AutomaticGroup> groups;  // empty where it could not start, or was cancelled
  std::vector<UncheckedScale> unchecked;
  std::vector<Gauge> gauges;  // of mounts; their components are fixed
  std::vector<OtherModel> other_models;
};

struct AutomaticOptions : CalibrationOptions {
  GroupChoice groups;
};

/// Returns the values that the widths of a solution's numbers count from, of the parameters that it
/// changed.
std::vector<NominalValue> nominal_values(const Solution& solution);

/// Returns in words why a number was held, and how well it is known.
std::string held_text(const AutomaticNumber& number);

/// Returns the rig's steps at the starting widths: what runs before anything is learned.
/// @throws as make_groups().
std::vector<Step> automatic_steps(const Recording& recording, const AutomaticOptions& options);

/// Calibrates a recording, whose rig's own steps are not looked at. How it ended is the solution's
/// status. @throws as make_groups() and calibrate().
AutomaticCalibration calibrate_automatically(const Recording& recording,
                                             const AutomaticOptions& options);

/// Passes one on that was not cancelled. @throws Cancelled
inline AutomaticCalibration uncancelled(AutomaticCalibration found) {
  if (found.solution.status == Status::cancelled) throw Cancelled();
  return found;
}

}  // namespace kincal
