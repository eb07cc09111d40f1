// The picture that the intensities of beams make, in which boards are found.
//
// Beams lie as the scanner laid them, coarser one way than the other, so it is a weighted mean of
// the beams around each pixel (a tent as wide as their distance), with square pixels.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

#include "beams.h"

namespace kincal {

/// A BeamPicture is the intensities with square pixels; the pixel (x, y) is at u = left + pitch x,
/// v = top + pitch y.
struct BeamPicture {
  cv::Mat level;                // CV_32F, from `dark` to `bright`
  double dark = 0, bright = 0;  // nearly all beams are between them
  double left = 0, top = 0, pitch = 1;

  /// Returns the same with 8 bits.
  cv::Mat grey() const;
};

/// A BeamBox is where beams are.
struct BeamBox {
  Eigen::Vector2d low = Eigen::Vector2d(1e300, 1e300), high = -low;

  void take(const Eigen::Vector2d& p) { low = low.cwiseMin(p), high = high.cwiseMax(p); }
};

/// Makes the picture of beams that are `step` apart, with pixels of `pitch`.
BeamPicture picture_of(const std::vector<const Beam*>& beams, const Eigen::Vector2d& step,
                       double pitch);

}  // namespace kincal
