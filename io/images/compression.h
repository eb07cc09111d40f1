// What JPEG did to the pixels of a picture.
//
// JPEG rounds the coefficients of the cosine transform of each 8 x 8 pixels to multiples of steps,
// which the file has. What it adds to a coefficient that is not rounded away is spread evenly over
// a step: step^2 / 12, whatever the noise was. It also rounds noise away where nothing else is, so
// that there the camera's noise cannot be seen from pixel to pixel. It shows in how often
// coefficients of flat blocks are another multiple than 0: sigma is the one by which the multiples
// there are most likely, of a normal distribution.
#pragma once

#include <array>
#include <opencv2/core.hpp>
#include <string_view>

namespace kincal {

/// A Compression is the steps of the coefficients: [8 v + u] of frequency u along x and v along y;
/// zeros: there was none.
struct Compression {
  std::array<int, 64> steps{};
  bool any() const { return steps[0] > 0; }
};

/// Returns the steps of brightness that the bytes of a JPEG name; none where they are not a JPEG.
Compression compression_of(std::string_view bytes);

/// A Block is 8 x 8 numbers, or their coefficients: (x or u, y or v).
using Block = cv::Matx<double, 8, 8>;

/// Returns the coefficients of a block (orthonormal, those of JPEG).
Block cosine_transform(const Block& pixels);

/// Returns the sigma of the camera's noise, in grey levels, where `box` of a compressed image is
/// flattest; below 0: nothing tells.
double noise_before(const cv::Mat& image, const cv::Rect& box, const Compression& compression);

}  // namespace kincal
