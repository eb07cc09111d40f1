// Where the lens of a camera starts when nothing is known of it.
//
// The principal point starts in the middle of the image, the lens without distortion, and the focal
// length where the boards fit best: for each of a row of focal lengths every view proposes the pose
// of its board in closed form (view_poses.h), and what these leave tells. A plane seen obliquely
// says by its homography how long the lens is (Zhang 2000); trying focal lengths says the same of
// targets that are not flat, and of a fisheye, whose homographies mean nothing. Views that all face
// the camera leave much the same at every focal length: one near the width of the image is taken
// then.
#pragma once

#include <vector>

#include "../rig/parameters.h"
#include "../rig/samples.h"

namespace kincal {

/// Returns how badly the views of a camera fit it with their boards at the poses that they propose:
/// the sum over views of ln(1 + mean square of the residuals in px), so that a bad view counts
/// little more than a poor one. `views` are of sensor 0 of the rig.
double lens_misfit(const Rig& rig, const std::vector<const View*>& views);

/// Returns fx fy cx cy of sensor 0 of the rig, a camera without distortion: the focal length that
/// fits best, and the middle of the image.
std::vector<double> find_focal_length(Rig rig, const std::vector<const View*>& views);

/// Returns the size of a camera's image in px: as the rig has it, else as far as the views reach.
Eigen::Vector2d image_size(const Sensor& camera, const std::vector<const View*>& views);

}  // namespace kincal
