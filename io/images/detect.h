// Targets in one image: which of their points it shows, and where. Pixels are as everywhere: (0, 0)
// is the centre of the top-left pixel.
#pragma once

#include <string>
#include <vector>

#include "../document/document.h"
#include "image_target.h"

namespace kincal {

/// Returns what the rig says of a target; `points` are its points in spacings of the grid.
/// @throws InputError where its type cannot be found in images, or a dictionary is unknown.
ImageTarget read_image_target(const std::string& name, const Field& field,
                              std::vector<cv::Point2d> points);

/// Finds a target in an image of 8 bits and one channel.
Detection detect(const cv::Mat& image, const ImageTarget& target);

/// Draws what was found into a picture (8 bits, three channels).
void draw(cv::Mat& picture, const ImageTarget& target, const Detection& found);

}  // namespace kincal
