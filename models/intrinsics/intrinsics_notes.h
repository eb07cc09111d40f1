// What whoever uses the lens of a camera should know: mistakes in the boards and the views, and
// what the views do not determine.
//
// Before any fit. Without distortion a camera sees a flat board by a homography, whatever its lens
// and wherever the board is; distortion bends that by a few percent of what the board covers. So
// what the best homography leaves of a view tells whether its corners are those of the board, and
// whether another number of them in a row suits it better.
//
// After the fit. A corner sticks out beyond eight times what the middle residual says of the noise,
// and beyond a pixel; it is the view that does where its middle corner is three times as far off as
// that of all views, and this one not far off that. Of a focal length and a principal
// point that are known to no better than 5 % of the focal length nothing is determined, nor by a
// single view of a flat board, which has two numbers for the four. Noise that comes of mistakes
// counts as a pixel and a half there.
#pragma once

#include <string>
#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// An IntrinsicsNote is something that whoever uses the result should know.
struct IntrinsicsNote {
  std::string id, text;
  bool spoils = false;  // the lens is wrong, however well it suits the views
};

/// Says of each board that a camera sees whether its corners are numbered as the rig has it, and
/// which views do not show it. `samples` are of the rig. One sentence each, with the cure.
std::vector<IntrinsicsNote> wrong_views(const Rig& rig, const std::vector<Sample>& samples,
                                        int sensor);

/// Says which views of a camera are copies of others, with the cure.
std::vector<IntrinsicsNote> copied_views(const Rig& rig, const std::vector<Sample>& samples,
                                         int sensor);

/// Says that boards look bent, by `most` m: what was held out is off by `flat` px where they are
/// taken as flat, and by `bent` px where they are not.
IntrinsicsNote bent_boards(double flat, double bent, double most);

/// Says that cameras do not see the same boards, where each by itself leaves no more than `alone`
/// px (rms) but together they leave `together`; empty: that is no reason to.
std::vector<IntrinsicsNote> apart(const std::vector<std::string>& cameras, double alone,
                                  double together);

/// AnotherLens says that some views of a camera are not of the lens that the others are of.
struct AnotherLens {
  std::string camera;
  std::vector<std::string> samples;  // of these views, quoted
  size_t views = 0;                  // all of the camera
  double together = 0, apart = 0;    // px (rms) that one lens leaves of all, and what else explains
  bool turned = false;               // by 180 degrees; else it is another lens
};
IntrinsicsNote another_lens(const AnotherLens& found);

/// A FittedLens is what is judged: a camera of a group's solution.
struct FittedLens {
  const Solution& solution;
  int sensor;             // of the solution's rig
  std::string lens;       // as lens_models() name it
  Eigen::Vector2d image;  // px
  long views, points;
  double noise, tilt;  // px along each axis; the largest angle between two boards, rad
};

/// Returns how badly the worst of fx, fy, cx, cy is known, relative to the focal length, where
/// `noise` px are left along each axis and the solution's sigmas are for `counted` px: NaN where
/// one is not determined.
double looseness(const ParameterEstimate& intrinsics, double noise, double counted);

/// Whether corners of a camera stick out of a solution's residuals, or whole views.
bool has_far_corners(const Solution& solution, int sensor);

/// Whether the views do not determine the lens: see above.
bool is_undetermined(const FittedLens& fit);

/// Returns what is to be said of a fit. `mistaken`: wrong_views() said something, from which the
/// rest follows.
std::vector<IntrinsicsNote> lens_notes(const FittedLens& fit, bool mistaken);

/// Whether the noise is far beyond what the rig states and beyond what detection leaves: the model
/// does not explain the views.
bool is_unexplained(const FittedLens& fit, double stated, bool mistaken);

}  // namespace kincal
