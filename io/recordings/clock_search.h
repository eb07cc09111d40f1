// Offsets in time of cameras that are larger than those of time_offset.h: computers whose clocks
// are seconds or minutes apart, in bags whose times of reception do not tell it.
//
// Evidence is the motion. Images are looked at evenly, all through the recording; a frame is still
// or moves, as those beside it show. Joints rest or move. If the stamps are late by `o`, a frame
// stamped t agrees with the joints where both rest or both move at t - o, and contradicts them
// where only one does. Candidates are the differences between the middles of the camera's rests and
// those of the joints; the best by agreements less contradictions, and all that are half as good,
// are tried: a robot that goes from posture to posture in equal times rests alike after each.
//
// Rests that are paired wrongly do not fit each other: for each candidate samples are made,
// calibrated, and the rest of the offset is estimated from the images on the ways (clocks.h).
// That with the least chi2/dof is right if the offset is known there, noise explains its chi2/dof,
// and the others have four times as much at least. Else none is known; then the stamps contradict
// the motion if some other candidate agrees twice as well with it as they do.
#pragma once

#include <string>
#include <vector>

#include "clocks.h"
#include "rests.h"

namespace kincal {

/// A CameraClock is what a search found.
struct CameraClock {
  int sensor = -1;
  double offset = 0;               // s: its images are stamped so much later than the readings
  bool found = false;              // the offset
  bool contradicted = false;       // else: the stamps as they are, by the motion
  std::vector<double> candidates;  // s, that agree with the motion about as well
};

/// Looks for the offsets of some cameras. `still_pixels` as for frame_tolerance. @throws InputError
/// as read_bag
std::vector<CameraClock> search_clocks(const Recorded& recorded, const Intervals& rests,
                                       const std::vector<int>& sensors, const TargetSearch& search,
                                       const LookOptions& look, double still_pixels);

}  // namespace kincal
