// Targets in the images of recordings, by the finders of `kincal detect`.
#pragma once

#include "../rig/rig_file.h"
#include "still_images.h"

namespace kincal {

/// Returns what searches images for the targets of a rig, which has to stay. Of ChArUco boards,
/// which are read in one of two layouts, agree() takes out what was read by the one that fewer
/// markers agree with. @throws InputError where the rig says of a target what no finder knows
TargetSearch image_search(const RigFile& rig);

}  // namespace kincal
