// The plan of a calibration, step by step: names are resolved to parameters, priors to components;
// parameters that no measurement depends on are omitted.
#pragma once

#include <string>
#include <vector>

#include "../estimation/setup.h"
#include "../rig/recording.h"
#include "../rig/selection.h"

namespace kincal {

/// A StepSelection is a caller's change to the steps of the rig.
struct StepSelection {
  std::string last_step;  // all steps up to this one run; empty: all
  std::vector<std::string> free,
      fix;  // names and globs, added to and removed from the last step that runs
};

/// A StepPlan is the plan of a step.
struct StepPlan {
  std::string name;
  std::vector<int> sensors;
  Loss loss;
  std::vector<Freed> free;
  std::vector<Prior> priors;
  std::vector<std::string> unused,
      held_out;  // estimated names on which no measurement depends; or only held-out samples
  std::vector<Freed> seen_held_out;  // the parameters of `held_out`, as the step estimates them
  std::vector<std::string> without_effect;  // of the last step: one message for each free and fix
                                            // of the selection that changes nothing
  long rows = 0,
       unknowns =
           0;  // whitened residuals, joint-error and prior terms; shared and private unknowns
  int samples = 0;
  bool repeated = false;  // a later step estimates all parameters of this one, which only starts it
};

/// Returns the plans of all steps that run, without counts. Errors of the selection begin with
/// "free[N]" or "fix[N]", the place in its lists, or with "last_step". @throws NameError;
/// std::invalid_argument naming the place: a rig without steps, an unknown last step, a pattern
/// without a match, a prior without an estimated parameter, a step without estimated parameters or
/// measurements.
std::vector<StepPlan> resolve_steps(const Recording& recording, const StepSelection& selection);

/// Checks that every step of the rig can be planned, each alone. @throws as resolve_steps();
/// std::invalid_argument: there are no samples.
void check_steps(const Recording& recording);

/// Fills `rows`, `unknowns` and `samples`.
void count(const Recording& recording, NoiseMode noise, StepPlan& plan);

}  // namespace kincal
