// How a plane is seen: a homography, then a lens with two radial numbers about the image's middle.
//
// A pixel q = H x of the homography, in units of half the image's diagonal from its middle, becomes
// q (1 + k1 |q|^2 + k2 |q|^4). The ten numbers are fitted to pixels by Gauss-Newton from the linear
// homography; a weak prior holds the lens where few points, or all near the middle, leave it open.
#pragma once

#include <opencv2/core.hpp>
#include <vector>

namespace kincal {

struct PlaneView {
  cv::Matx33d h;                  // from the plane to units of `radius`, from `middle`
  double k1 = 0, k2 = 0;          // the lens
  cv::Point2d middle;             // px, of the image
  double radius = 1;              // px
  double rms = 1e9, worst = 1e9;  // px, distances of the points it was fitted to

  /// Returns where a point of the plane is in the image, px.
  cv::Point2d operator()(const cv::Point2d& p) const;
};

/// Fits the view of a plane; with fewer than 6 points the lens has no numbers, with fewer than 12
/// one. Where nothing can be fitted (fewer than 4 points, all on a line) rms stays at 1e9.
PlaneView fit_plane_view(const std::vector<cv::Point2d>& plane,
                         const std::vector<cv::Point2d>& pixels, cv::Size image);

}  // namespace kincal
