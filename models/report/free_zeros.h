// What nothing can tell of the zeros of the first and the last joint.
//
// Things that stand at the base (a camera in the room, a tracker, a board on the table) with a pose
// to be estimated move with the first joint: its zero and origin, and where the base frame is, are
// the same numbers. Likewise what sits behind the last joint (a camera, a board in the hand) and
// that joint's zero. No posture tells them apart, and no measurement depends on the choice; a
// prior, or the width of a group, makes it, and is all that these poses are known to. At the base
// that is harmless; at the other end it matters for what else sits there (a tool), and is said.
// Neither is mended by more samples, unlike the same sigma of anything else.
#pragma once

#include <map>
#include <string>
#include <vector>

#include "report.h"

namespace kincal {

/// A FreeZero is a joint whose numbers and the poses at one end of the robot are one.
struct FreeZero {
  bool at_base = true;                // else behind the last joint
  std::string joint;                  // the first or last one
  std::string number;                 // of it: the name of the one that matters most
  bool is_zero = true;                // that is its offset; else a number of its origin
  std::map<Component, double> sigma;  // of poses at this end, were this joint's numbers known
};

/// Returns them for a report that is otherwise complete; none where these joints are determined or
/// held, or nothing at the ends is estimated.
std::vector<FreeZero> free_zeros(const Report& report);

/// Returns the sigma of a component by which to judge how well it is known, and which free zero, if
/// any, makes it less than it seems: what it would be without. (One above 0.3 m or 30 degrees stays
/// as it is: that is no choice.)
struct JudgedSigma {
  double sigma;
  const FreeZero* zero;  // null: as it is
};
JudgedSigma judged_sigma(const std::vector<FreeZero>& zeros, const ParameterEstimate& e, size_t c);

/// Returns the number of a pose to hold where all turning axes are parallel (of a SCARA) and the
/// given one, known badly, is a length along them: then the heights of what is mounted at both ends
/// are one number. "": something else.
std::string height_to_hold(const Report& report, const ParameterEstimate& e, size_t c);

}  // namespace kincal
