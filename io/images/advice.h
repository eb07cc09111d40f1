// What all pictures together say of the rig: a target that none shows, and the one there instead, a
// board that is not flat, another size of all images.
#pragma once

#include <string>
#include <vector>

#include "image_task.h"

namespace kincal {

/// Returns what there is to say; `found`: those of the `known` targets that some image shows.
std::vector<std::string> advice(const ImageTargets& known, const ImageTargets& found,
                                const std::vector<ImageTask>& tasks);

}  // namespace kincal
