// What the motion of a robot lacks to tell where things sit on it (hand-eye calibration).
//
// Of a camera and a board that both sit on a robot, or one of them around it, two poses are
// unknown: A_i X = Y B_i. Two poses leave a turn and a slide along the axis between them open;
// turns about one axis, however many, a slide along that; without turns translations of X are not
// seen at all (Tsai and Lenz 1989).
#pragma once

#include <string>
#include <vector>

#include "../rig/recording.h"

namespace kincal {

/// How far something turned from where it was first: at most, and about other axes than the one
/// that it turned about most; rad.
struct Turns {
  double most = 0, others = 0;
};
Turns turns_of(const std::vector<Matrix3d>& rotations);

/// A MotionLack is what is missing, what to record, and what to do where that cannot be; all are
/// empty where nothing is missing.
struct MotionLack {
  std::string why, cure, otherwise = {};
};
/// Looks at the training samples: at how the flange turned of a robot that is known by its poses,
/// else at how sensors turned against mounted targets, by the readings and the rig's geometry. It
/// says nothing where some view tells more than one pose of these: of a target that is not mounted,
/// by a sensor of single points, by a scanner.
MotionLack motion_lack(const Recording& recording);

}  // namespace kincal
