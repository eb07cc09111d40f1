// Cameras and targets that came out where the rig has none: two in each other's place, for somebody
// exchanged their names; the two of a rectified pair apart along its baseline, for that is wrong.
// Where their poses are free nothing else shows it, for the data are explained as well.
#pragma once

#include <vector>

#include "../analysis/residuals.h"
#include "../calibration/solution.h"
#include "../doctor/diagnosis.h"

namespace kincal {

/// Returns the contradictions between the rig and a calibration that explains its data, the first
/// of these that there is:
/// - pairs of cameras (`swapped-cameras`) and of mounted targets of one type and size
///   (`exchanged-targets`) with given places of which each was found where the other was given:
///   within a third of the distance of these, and farther than three quarters from its own;
/// - mounted markers that every view of a camera shows from behind: their corners go the other way
///   round (`mirrored`);
/// - rectified pairs whose cameras, at one place in the rig, were found apart along the baseline by
///   more than 3 % of it and five sigmas of that distance (`baseline`);
/// - bent_boards().
Notices not_as_given(const Solution& solution, const Residuals& residuals);

/// Whether a pose that the rig gives was found turned by more than a radian from it: a rough pose,
/// or a mistake that it took up.
bool is_a_given_pose_turned(const Solution& solution);

}  // namespace kincal
