// Which hand holds a free target in which sample.
//
// A camera whose place is known roughly says where a target is (perspective pose), and joint
// readings say where each hand is. The hand that holds it is the one to which it always has the
// same pose: the rig's `pose` of the chain, or where the rig has none the pose that most samples
// agree on, at least three. Poses agree within 0.25 m and 30 degrees, so much may a robot that was
// never calibrated be wrong.
#pragma once

#include <string>
#include <vector>

#include "../../models/rig/recording.h"

namespace kincal {

/// Adds the views of the chains that hold free targets to samples. Returns what there is to say.
std::vector<std::string> add_holding_chains(const Rig& rig, std::vector<Sample>& samples);

}  // namespace kincal
