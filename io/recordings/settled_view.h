// When a target stands still in a camera's images, and where its corners are then.
//
// Frames of one rest are compared with the rest's median corners by the root mean square over the
// corners that both show. The noise of such a distance is learned from frames that follow each
// other, in all rests of the camera: half of the mean square of their difference is a corner's
// scatter; the median of all pairs is robust against rests that are none. A frame is still within
// three of these, or within a third of the rig's sigma, which does no harm. The longest run of
// still frames is the view's rest.
//
// Noise. The finder tells how much of a corner's sigma is no noise (sampling, edges nearby): that
// is a floor, which averages keep, beside the rig's sigma:
//     sigma^2 = scatter^2 / n + floor^2 + sigma_rig^2.
#pragma once

#include <vector>

#include "settle.h"

namespace kincal {

/// A CornerFrame is what one image shows of a target.
struct CornerFrame {
  double time = 0;             // s
  std::vector<int> ids;        // ascending
  std::vector<double> pixels;  // 2 an id
  double floor = 0;            // px: the sigma of a coordinate, without what is noise
};

/// Returns the scatter of a coordinate of a corner from frame to frame, in px; 0: there are no two
/// frames that follow each other. `rests`: frames of each rest, in the order of their times.
/// `quantile` is of the pairs: the median, or less where most frames are of motion.
double corner_scatter(const std::vector<std::vector<CornerFrame>>& rests, double quantile = 0.5);

/// Returns how far a frame may be from the median corners while its target is still, px: what is
/// `given`; if that is NaN three of the camera's `usual` scatters or the rest's `own` if that is
/// larger, for what is small in an image has more noise, but no more than nine usual ones; or a
/// third of the rig's `sigma`.
double frame_tolerance(double given, double usual, double own, double sigma);

/// Returns the times in which frames are still, where no joints tell when that may be: stretches
/// whose frames are all within `tolerance` px, times the root of two, of their first one. None goes
/// over a gap of more than `longest_gap` s.
Intervals still_frames(const std::vector<CornerFrame>& frames, double tolerance,
                       double longest_gap);

/// A ViewRest is how still a target is in the frames of one rest.
struct ViewRest {
  TimeInterval still;  // from the first to the last frame of the longest run
  size_t frames = 0;   // in it
  double motion = 0;   // px: the largest distance of a frame from the median corners, root mean
                       // square of coordinates
};

/// Finds the longest run of frames whose corners are within `tolerance` px (root mean square) of
/// the median of it.
ViewRest view_rest(const std::vector<CornerFrame>& frames, double tolerance);

/// SettledCorners are averages over frames.
struct SettledCorners {
  std::vector<int> ids;        // of corners that at least half of the frames show
  std::vector<double> pixels;  // 2 an id
  double scatter = 0;          // px, of a coordinate in one frame
  double frames = 0;           // mean number of frames a corner is the average of
  bool scatter_known = false;  // two frames at least
  double floor = 0;            // px: root mean square of those of the frames

  /// Returns the sigma of an averaged coordinate: of the scatter, the floor, and one that the rig
  /// has; averaging removes neither of these.
  double sigma(double sigma) const;
};

/// Averages the corners of the frames in a time. Corners that are far off (six scatters and a
/// hundredth of a pixel from the median) in single frames do not count there.
SettledCorners average_corners(const std::vector<CornerFrame>& frames, const TimeInterval& over);

}  // namespace kincal
