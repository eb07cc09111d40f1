// The alternative that the URDF is that of another robot: one of the same family, or an older
// drawing. Its lengths differ by far more than links are machined, and lengths that no measurement
// depends on differ as well.
//
// Lengths. The groups (groups.h) assume errors x_i ~ N(0, f^2 s_i^2) with one factor f. The lengths
// l_i that another robot's URDF has are off by
//     x_i ~ N(0, S_i^2),   S_i = max(s_i, min(usual error, |l_i|))
// (rig/scales.h). Offsets that are zero in the URDF (S_i = s_i) are zero in the whole family, and
// the group's factor f is learned from these alone (widths.h).
// Rigs are not judged where measurements would also suit a robot of no size (other_models.h): all
// residuals of such a sensor shrink with the robot, which so would be likely.
//
// Odds. With prior odds of one to a hundred and the gain of log evidence and log hyperprior, first
// in the quadratic model, then by a fit of its own (evidence.h: with all unknowns, and noise that
// may be larger than stated instead):
//     odds = 0.01 (exp(gain) - 1);   without a gain it is no alternative.
// (Hence data that say nothing of lengths leave them as certain as the rig states them.)
//
// Errors. Let P be its probability, x1 and M1 its estimate and second moment, x0 and M0 those of
// the groups, which are reported. Errors have M0 with probability 1 - P, else M1 + m m' with
// m = x1 - x0; the predicted ones cover this mixture (widths.h).
// One width for all lengths cannot express it: 18 mm in one of eight directions become 6 mm in
// each, and 6 mm in a length that no measurement depends on.
#pragma once

#include <vector>

#include "../fitting/fit.h"
#include "unchecked_scales.h"

namespace kincal {

/// An OtherRobot is this alternative for the lengths of one group.
struct OtherRobot {
  int group = -1;
  double probability = 0;
  MatrixXd second_moment;     // M1 + m m', by unknown
  std::vector<double> width;  // S_i of the group's members, unseen ones behind; 0: S_i = s_i

  /// The covariance of predicted errors, with `own` that of the groups.
  MatrixXd mixed(const MatrixXd& own) const { return covering(own, second_moment, probability); }
  /// The width of member k, with `own` that of its group.
  double mixed(size_t k, double own) const;
};

/// A GroupedFit is a fit with the groups, and their widths.
struct GroupedFit {
  const AutomaticGroups& groups;
  const FitWidths& at;
  const Widths& widths;
  const EstimationSetup& setup;  // with priors of any width
  const Values& values;
};

/// Returns it for each group that has evidence for it. It allocates.
std::vector<OtherRobot> other_robots(const Recording& recording, const GroupedFit& fitted,
                                     const FitOptions& options);

}  // namespace kincal
