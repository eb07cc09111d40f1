// Boards of one print in one picture, told apart by the robot.
//
// The finders see that there are so many boards of a print, and not which is which. The joint
// readings tell, with where the rig has the camera and the targets: so the points of each target
// are predicted, as directions from the camera. A board's distance from a target is the angle
// between the directions seen and predicted (rms over its points; of the numberings that are one
// picture the nearest). Of all ways to give the boards of a picture different targets that one is
// taken whose distances are least (rms over its boards). A board is told if every way that gives it
// another target is at least twice as far, and if it is not farther from its own than it is wide;
// else it is left out, with the reason.
#pragma once

#include <nlohmann/json.hpp>
#include <vector>

#include "../rig/rig_file.h"
#include "image_task.h"

namespace kincal {

/// @throws InputError where an image may show targets that look the same and cannot be told apart
/// by the robot, whatever the pictures show.
void refuse_alike(const RigFile& rig, const std::vector<nlohmann::ordered_json>& samples,
                  const std::vector<ImageTask>& tasks);

/// Gives the boards that were found of one print each to its target.
void tell_apart(const RigFile& rig, const std::vector<nlohmann::ordered_json>& samples,
                std::vector<ImageTask>& tasks);

}  // namespace kincal
