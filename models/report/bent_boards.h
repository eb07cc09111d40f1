// Boards that are bent: what is taken for flat and bulges by a few tenths of a millimetre pulls
// lenses and mounts by many of their sigmas, with residuals that are hardly larger than the noise.
//
// A screen comes first, of residuals that are there already. With w_i the whitened residual of a
// view's point i in one component and b_i how far the point stands out of a board that bulges by
// one (warp_shapes(), counted from its mean over the view),
//     t = (sum w_i b_i)^2 / sum b_i^2
// is on average the mean square of w where nothing is bent, so the ratio of the two, over n views
// and components, is above 1 + 4 sqrt(2 / n) once in some 10,000 boards. The warps of boards that
// stand out so are tried as a further model (automatic/further.h), by evidence and held-out
// samples.
#pragma once

#include <vector>

#include "../analysis/residuals.h"
#include "../calibration/solution.h"
#include "../doctor/diagnosis.h"

namespace kincal {

/// Returns a finding (`bent`) for each board that is flat in the rig and has a warp
/// that moves some parameter by two of its sigmas.
Notices bent_boards(const Solution& solution, const Residuals& residuals);

}  // namespace kincal
