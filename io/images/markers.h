// Markers in a picture: where OpenCV finds them, and what the finders of boards of markers share.
#pragma once

#include <array>
#include <map>
#include <opencv2/core.hpp>
#include <string>
#include <vector>

#include "image_target.h"
#include "plane_view.h"

namespace kincal {

using Quad = std::array<cv::Point2d, 4>;  // clockwise from the marker's upper left
using Markers = std::multimap<int, Quad>;
using Places = std::vector<cv::Point2d>;

/// What a search for markers takes for ink.
struct MarkerSearch {
  int border = 1;            // cells of a marker's dark border
  double darker = 7;         // by so many grey levels than the mean of what is around it
  int least = 3, most = 43;  // px, widths of the windows of that mean; wide ones part tags from
                             // squares that touch them. One width is an eighth of the time
};

/// All that are seen whole. A number may be there twice: what else looks like a code.
Markers find_markers(const cv::Mat& image, int dictionary, const MarkerSearch& search);

/// Those of a board, numbered from its first one.
Markers find_markers(const cv::Mat& image, const ImageTarget& board, const MarkerSearch& search);

/// Cells of a dictionary's codes along an edge, without their border.
int bits_of(int dictionary);

/// The shortest of the four, px.
double edge_length(const Quad& quad);

double brightness(const cv::Mat& image, cv::Point2d p);

/// Moves the corners of a dark quad to where its edges meet: each is a parabola (of the lens)
/// fitted to where the brightness changes within `reach` px; its ends are left out, blur makes them
/// round. A quad that would run away stays.
Quad refine_quad(const cv::Mat& image, const Quad& given, double reach);

/// The number of points that agree with one homography; which ones, in `inliers`.
int agreeing(const Places& plane, const Places& pixels, double tolerance, cv::Mat& inliers);

/// Fits one view of a plane to the corners of markers, four of each in turn. Returns whether it
/// explains all: no number was misread, and the lens is not too much for the view. Contours run
/// inside of the ink, so a marker's corners may be a pixel or two off, its middle not.
bool in_one_view(const Places& plane, const Places& pixels, cv::Size image, PlaneView& view);

/// Returns a detection of nothing, with the reason.
Detection missing(const std::string& reason);

}  // namespace kincal
