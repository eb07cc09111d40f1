// Lengths that are all wrong by one factor: a board's square sets the scale of whatever is seen of
// it, and where no length of the robot is beside it, cameras that look around from one place, the
// data fit whatever the square.
//
// Common scale. Where sensors and mounted targets stand, in the base frame at one sample's
// readings, as the rig has it (p_i) and as it came out (q_i), are alike but for where the base is
// and how it is turned, and for errors of the mounts. The similarity q = s R p + t of least squares
// (Umeyama, IEEE PAMI 13, 1991) has with x_i, y_i counted from their means
//     s = sum y_i . R x_i / sum |x_i|^2,   R from the singular vectors of sum y_i x_i',
// 3 n - 7 residuals are left over, whose mean square is the variance of the mounts' errors, and
//     variance of s = that / sum |x_i|^2,
// (of what a robot's link carries the mean counts once), so (s - 1) over its root is as a Student
// number of 3 n - 7 degrees of freedom if nothing is scaled.
#pragma once

#include "trial_warnings.h"

namespace kincal {

/// Warns of a common scale (`scale`; of an arm whose lengths sensors measure: `arm_scale`), and of
/// lengths that nothing checks (`unchecked`).
void warn_of_scales(const Report& report, Notices& out);

/// Returns what a good result hangs on, as a sentence without full stop: "it is as right as the
/// square of target 'board', which nothing checks"; "": nothing.
std::string unchecked_words(const Report& report);

}  // namespace kincal
