// Targets in one image: which of their points it shows, and where. Pixels are as everywhere: (0, 0)
// is the centre of the top-left pixel.
#pragma once

#include "compression.h"
#include "image_target.h"

namespace kincal {

/// Finds a target in an image of 8 bits and one channel. `compression` is what it went through.
Detection detect(const cv::Mat& image, const ImageTarget& target,
                 const Compression& compression = {});

/// Finds as many boards of one print as there are, at most `count`: never one twice. Of the others
/// the reason is returned.
std::vector<Detection> detect_boards(const cv::Mat& image, const ImageTarget& target, size_t count,
                                     const Compression& compression = {});

/// Draws what was found into a picture (8 bits, three channels).
void draw(cv::Mat& picture, const ImageTarget& target, const Detection& found);

}  // namespace kincal
