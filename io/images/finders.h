// One finder for each kind of print: from an image to ids and pixels, which are empty where the
// target is not found. detect() calls them, and judges what they return.
#pragma once

#include <vector>

#include "image_target.h"

namespace kincal {

Detection find_chessboard(const cv::Mat& image, const ImageTarget& target);
Detection find_circles(const cv::Mat& image, const ImageTarget& target);
Detection find_charuco(const cv::Mat& image, const ImageTarget& target);
Detection find_tags(const cv::Mat& image, const ImageTarget& target);
Detection find_marker(const cv::Mat& image, const ImageTarget& target);

/// Moves saddle points to where the image has them. `reach` is the distance of each to the next
/// thing that is no part of it, px. Points that run away stay where they were.
void refine_saddles(const cv::Mat& image, const std::vector<double>& reach,
                    std::vector<cv::Point2d>& pixels);

}  // namespace kincal
