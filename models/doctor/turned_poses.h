// Fixed poses that are wrong by a plain rotation: by 90 or 180 degrees about an axis, or link
// frames (x forward) taken for optical frames (z forward).
//
// The pose is freed and found in closed form. If it comes out near one of the 23 turns of a cube,
// that turn is a hypothesis, which a fit with the pose fixed there judges. So no turn has to be
// tried that the data do not suggest.
#pragma once

#include <vector>

#include "trial_fits.h"

namespace kincal {

/// True if a rotation turns the axes onto each other.
bool is_cube_turn(const Matrix3d& rotation);

/// Returns what is meant by a rotation whose quaternion was written w x y z in place of x y z w.
Matrix3d of_w_x_y_z(const Matrix3d& given);

/// Returns turns of held poses of sensors and mounted targets, and of fixed joints above them, that
/// the data suggest.
std::vector<Hypothesis> turned_poses(const Recording& recording, const TrialContext& context);

}  // namespace kincal
