// One finder for each kind of print: from an image to ids and pixels, which are empty where the
// target is not found. detect() calls them, and judges what they return.
#pragma once

#include <vector>

#include "compression.h"
#include "image_target.h"

namespace kincal {

Detection find_chessboard(const cv::Mat& image, const ImageTarget& target,
                          const Compression& compression);
/// Returns the rows and columns of inner corners that an image shows where a chessboard was not
/// found, at most one row and one column from it; zeros: none of these.
cv::Size size_instead(const cv::Mat& image, const ImageTarget& target);
Detection find_circles(const cv::Mat& image, const ImageTarget& target);
Detection find_charuco(const cv::Mat& image, const ImageTarget& target,
                       const Compression& compression);
Detection find_tags(const cv::Mat& image, const ImageTarget& target,
                    const Compression& compression);
Detection find_marker(const cv::Mat& image, const ImageTarget& target);

/// Says how the picture is where the points are: contrast, blur, noise.
void judge(const cv::Mat& image, Detection& found);

}  // namespace kincal
