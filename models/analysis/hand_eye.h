// What the motion of a flange lacks to tell where things sit on it (hand-eye calibration).
//
// A robot that is known by the poses of its flange only has two unknown poses, of what is on the
// flange and of what stands still: A_i X = Y B_i. Two poses of the flange leave a turn and a slide
// along the axis between them open; turns about one axis, however many, a slide along that; without
// turns translations of X are not seen at all (Tsai and Lenz 1989).
#pragma once

#include <string>

#include "../rig/recording.h"

namespace kincal {

/// A FlangeLack is what is missing, and what to record; both are empty where nothing is.
struct FlangeLack {
  std::string why, cure;
};
/// Looks at the training samples. Of a robot with other joints that move it says nothing.
FlangeLack flange_lack(const Recording& recording);

}  // namespace kincal
