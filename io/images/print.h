// What is printed on a target: the inverse of what the finders look for. To be printed, and for
// pictures of a simulation.
#pragma once

#include <functional>

#include "image_target.h"

namespace kincal {

/// A Print is a sheet with something dark on it, in the coordinates of ImageTarget::points.
struct Print {
  std::function<double(double x, double y)> brightness;  // 0 (ink) to 1 (paper)
  cv::Rect2d sheet;                                      // what there is of it
};

/// Returns the print of a target as the finders know it, with paper around it. Dots have a radius
/// of 0.3 spacings (asymmetric grids: 0.4; beside a bigger one, which has 1.4 times that, 0.25);
/// the upper left square of a ChArUco board is dark; a grid of tags is Kalibr's.
Print print_of(const ImageTarget& target);

}  // namespace kincal
