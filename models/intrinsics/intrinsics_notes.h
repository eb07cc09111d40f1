// Notes for users of a calibrated lens: mistakes in the boards and the views, and parameters that
// the views do not determine.
//
// Before any fit. Without distortion a camera sees a flat board by a homography, whatever its lens
// and wherever the board is; distortion changes this by a few percent of the board's image. So the
// residuals of the best homography show whether a view's corners are those of the board, and
// whether another number of corners per row fits better.
//
// After the fit. A corner is an outlier beyond eight times the noise given by the median residual,
// and beyond a pixel. The whole view is one if its median corner error is three times that of all
// views, and the corner is not far beyond that. A lens is not determined if the sigma of focal
// length or principal point exceeds 5 % of the focal length, or if there is a single view of a flat
// board, which gives two constraints for the four parameters. Noise caused by mistakes counts as a
// pixel and a half there.
#pragma once

#include <string>
#include <vector>

#include "../calibration/solution.h"

namespace kincal {

/// An IntrinsicsNote is a remark for users of the result.
struct IntrinsicsNote {
  std::string id, text;
  bool spoils = false;  // the lens is wrong, however well it fits the views
};

/// Returns notes on each board that a camera sees: whether its corners are numbered as in the rig,
/// and which views do not show it. `samples` are those of the rig. Each is one sentence with the
/// remedy.
std::vector<IntrinsicsNote> wrong_views(const Rig& rig, const std::vector<Sample>& samples,
                                        int sensor);

/// Returns notes on views of a camera that are copies of others, with the remedy.
std::vector<IntrinsicsNote> copied_views(const Rig& rig, const std::vector<Sample>& samples,
                                         int sensor);

/// Returns the note that boards appear bent, by up to `most` m: the held-out error is `flat` px
/// with flat boards and `bent` px with warped ones.
IntrinsicsNote bent_boards(double flat, double bent, double most);

/// Returns the note that cameras do not see the same boards, if the rms is at most `alone` px for
/// each camera alone but `together` px jointly; empty if this is not significant.
std::vector<IntrinsicsNote> apart(const std::vector<std::string>& cameras, double alone,
                                  double together);

/// AnotherLens describes a camera in whose samples some views belong to another lens.
struct AnotherLens {
  std::string camera;
  std::vector<std::string> samples;  // of these views, quoted
  size_t views = 0;                  // all of the camera
  double together = 0, apart = 0;    // rms in px with one lens for all, and with the alternative
  bool turned = false;               // by 180 degrees; else it is another lens
};
IntrinsicsNote another_lens(const AnotherLens& found);

/// A FittedLens is the input of the judgement: a camera of a group's solution.
struct FittedLens {
  const Solution& solution;
  int sensor;             // of the solution's rig
  std::string lens;       // its name in lens_models()
  Eigen::Vector2d image;  // px
  long views, points;
  double noise, tilt;  // px along each axis; the largest angle between two boards, rad
};

/// Returns the largest sigma of fx, fy, cx, cy relative to the focal length. `noise` is the
/// residual noise in px along each axis; the solution's sigmas are for noise of `counted` px. NaN
/// if one of them is not determined.
double looseness(const ParameterEstimate& intrinsics, double noise, double counted);

/// Returns whether a solution's residuals contain outlier corners or views of a camera.
bool has_far_corners(const Solution& solution, int sensor);

/// Returns whether the views do not determine the lens (see the top of this file).
bool is_undetermined(const FittedLens& fit);

/// Returns the notes on a fit. `mistaken`: wrong_views() returned notes; most others are then
/// omitted, because a wrong view can be their cause.
std::vector<IntrinsicsNote> lens_notes(const FittedLens& fit, bool mistaken);

/// Returns whether the noise is far above the rig's sigma and above that of detection: the model
/// then does not explain the views.
bool is_unexplained(const FittedLens& fit, double stated, bool mistaken);

}  // namespace kincal
