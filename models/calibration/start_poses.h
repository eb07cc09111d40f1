// Where a calibration starts: poses in closed form (fitting/unknown_poses.h).
//
// A pose of a sensor or mounted target that the rig leaves open, and that the steps free wholly and
// without a prior, starts where the data put it; estimates count from there.
//
// A pose that the rig gives starts as given. Where the run from there ends badly (a residual is
// undefined at the start, a step does not converge, or the cost is more than four times what chance
// explains), the given poses may be far off: a camera that looks backwards, a mount turned by 90
// degrees. Then those that are freed wholly and without a prior are found in closed form as well,
// the origin of a fixed joint as the pose of what stands behind it, and the steps run again from
// there; estimates count from the given poses all the same. The second run stays if its cost is a
// quarter of the first's or less, or if it is usable where the first was undefined; else, and where
// the closed form agrees with the end of the first run, all is as if it had not been tried. So a
// start that is good is used as it is and costs nothing.
#pragma once

#include <string>
#include <vector>

#include "plan.h"
#include "solution.h"

namespace kincal {

/// Sets the poses that the rig leaves open in the solution's initial values and values.
void start_absent_poses(const std::vector<StepPlan>& plans, Solution& solution);

/// Returns why a pose of solution.lost_starts has no start and what helps, for a message; "" if the
/// calibration ended well all the same.
std::string lost_start_text(const Solution& solution, const std::string& pose);

/// Returns whether a run that stands at `solution` ended so badly that its start may be to blame.
bool ended_badly(const Solution& solution);

/// Sets the poses that the rig leaves open in initial values and values, and those that it gives in
/// the values only. Returns false if there are none of these, or if they agree with where `first`
/// ended.
bool start_given_poses(const std::vector<StepPlan>& plans, const Solution& first,
                       Solution& solution);

/// Returns whether a run from the closed form is to stay in place of that from the given poses.
bool decisively_better(const Solution& again, const Solution& first);

/// Sets solution.replaced_starts: the given poses that the estimate left far behind.
void name_replaced_starts(const std::vector<StepPlan>& plans, const Solution& first,
                          Solution& solution);

}  // namespace kincal
