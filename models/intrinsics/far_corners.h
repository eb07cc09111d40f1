// Corners and views of a camera that do not belong to the others, taken out before its lens is
// chosen: one corner that is 30 px off makes what is held out so uncertain that the simplest lens
// of all is not worse by a standard error, and its numbers are 45 sigmas off then.
//
// A plain fit of a lens with all usual distortion tells whether anything sticks out
// (intrinsics_notes.h); only then the outliers are found as those of a calibration are
// (trials/outliers.h).
#pragma once

#include <optional>
#include <vector>

#include "intrinsics_notes.h"
#include "one_camera.h"

namespace kincal {

/// Takes such corners and views of one camera out of the samples of `rig`, and says which. Where a
/// tenth of the corners would be out, nothing is: then it is the model that is wrong. @throws
/// Cancelled
std::vector<IntrinsicsNote> take_out_far(const Rig& rig, int camera,
                                         const CalibrationOptions& options,
                                         std::vector<Sample>& samples);

}  // namespace kincal
