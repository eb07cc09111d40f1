// Error curves of joints (joints/curve_joint.h) on the automatic path: which joints get one.
//
// An error that comes back at the same angle of a joint is not noise. At the fit without
// curves, whose noise of the readings has them in it, the curve of each joint alone is freed with a
// learned width (widths.h): the data's quadratic model says how much log evidence it gains. With
// those that gain enough everything is calibrated again, noise and all, and those that lose their
// evidence on the way are left away.
#pragma once

#include <memory>
#include <vector>

#include "width_problem.h"

namespace kincal {

/// Returns the recording with error curves of these joints, which are nothing yet.
std::shared_ptr<const Recording> with_curves(const Recording& recording,
                                             const std::vector<int>& joints);

/// Returns which of the joints that it was asked for (AutomaticGroups::curves) have evidence for an
/// error curve at a fit of a recording without. `factor`: of the groups' widths there.
std::vector<int> joints_with_curves(const Recording& recording, const EstimationSetup& fitted,
                                    const Values& values, const AutomaticGroups& groups,
                                    const VectorXd& factor);

}  // namespace kincal
