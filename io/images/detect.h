// Targets in one image: which of their points it shows, and where. Pixels are as everywhere: (0, 0)
// is the centre of the top-left pixel.
#pragma once

#include "image_target.h"

namespace kincal {

/// Finds a target in an image of 8 bits and one channel.
Detection detect(const cv::Mat& image, const ImageTarget& target);

/// Draws what was found into a picture (8 bits, three channels).
void draw(cv::Mat& picture, const ImageTarget& target, const Detection& found);

}  // namespace kincal
