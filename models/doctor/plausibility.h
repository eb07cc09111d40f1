// Values of a rig and its samples that are far from usual, found before any fit: they show a
// mistake but do not prove it.
//   square      fields above 2 m; points or positions above 50 m, measured ones above 200 m
//   degrees     readings of more than three times a joint's limits, or of eight turns
//   units       a sensor, target or joint more than 50 m from its link; links from 5 m and eight
//               times the next, or from 20 m; slides at three times their limits and 1 m beyond,
//               without limits 20 m
//   baseline    above 3 m, missing, or of the wrong sign
//   intrinsics  another order or scale suits the image; (cx, cy) outside of it; a focal length
//               below a tenth of its width
//   resolution  all points in an upper left part of the image, in at least 8 views
#pragma once

#include <vector>

#include "../notices/notice.h"
#include "../rig/rig.h"
#include "../rig/samples.h"

namespace kincal {

/// Finds duplicates of samples, points outside of a camera's image or all in a corner of it,
/// intrinsics in another order or of another resolution, lengths in millimetres and angles in
/// degrees. No finding has a chi2.
std::vector<Notice> find_implausible(const Rig& rig, const std::vector<Sample>& samples);

}  // namespace kincal
